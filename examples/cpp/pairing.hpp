// Pairs two topics by stamp, as message_filters::TimeSynchronizer does, with a queue that may differ from ROS's usual 10.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <utility>

/// Keeps `queue` messages of each topic that wait for their partner. Both need a header.
template <class First, class Second>
class Pairing
{
public:
  using Take = std::function<void(const First &, const Second &)>;

  Pairing(std::size_t queue, Take take) : queue_(queue), take_(std::move(take)) {}

  void add(std::shared_ptr<const First> message)
  {
    keep(firsts_, std::move(message));
  }

  void add(std::shared_ptr<const Second> message)
  {
    keep(seconds_, std::move(message));
  }

private:
  template <class Message>
  void keep(std::map<std::int64_t, std::shared_ptr<const Message>> & kept, std::shared_ptr<const Message> message)
  {
    const auto & stamp = message->header.stamp;
    const std::int64_t stamp_ns = stamp.sec * std::int64_t{1000000000} + stamp.nanosec;
    kept[stamp_ns] = std::move(message);
    take(stamp_ns);
    while (kept.size() > queue_) {
      kept.erase(kept.begin());  // the oldest
    }
  }

  void take(std::int64_t stamp_ns)
  {
    const auto first = firsts_.find(stamp_ns);
    const auto second = seconds_.find(stamp_ns);
    if (first != firsts_.end() && second != seconds_.end()) {
      take_(*first->second, *second->second);
      firsts_.erase(first);
      seconds_.erase(second);
    }
  }

  std::size_t queue_;
  Take take_;
  std::map<std::int64_t, std::shared_ptr<const First>> firsts_;
  std::map<std::int64_t, std::shared_ptr<const Second>> seconds_;
};
