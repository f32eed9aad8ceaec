// Warps images to the reference, from `image_raw` and `homography` of the tracker, which are paired by stamp.
//
//   ros2 run stab_ros_consumer warp_node --ros-args -r __ns:=/camera -p start_s:=1.0 -p rate_hz:=30.0
//
// Publishes `~/image_warped`. The queue holds the frames of the tracker's start, which are answered `start_s` late.

#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>

#include <rclcpp/rclcpp.hpp>

#include "pairing.hpp"
#include "warp.hpp"

using sensor_msgs::msg::CameraInfo;
using sensor_msgs::msg::Image;

class WarpNode : public rclcpp::Node
{
public:
  WarpNode()
  : Node("warp_node"),
    queue_(queue()),
    pairing_(queue_, [this](const Image & image, const CameraInfo & answer) {warp(image, answer);})
  {
    warped_ = create_publisher<Image>("~/image_warped", queue_);
    images_ = create_subscription<Image>(
      "image_raw", queue_, [this](Image::ConstSharedPtr message) {pairing_.add(std::move(message));});
    answers_ = create_subscription<CameraInfo>(
      "homography", queue_, [this](CameraInfo::ConstSharedPtr message) {pairing_.add(std::move(message));});
  }

private:
  std::size_t queue()
  {
    const double start_s = declare_parameter("start_s", 1.0);
    const double rate_hz = declare_parameter("rate_hz", 30.0);
    return static_cast<std::size_t>(std::ceil(start_s * rate_hz)) + 10;  // and some while a frame is answered
  }

  void warp(const Image & image, const CameraInfo & answer)
  {
    const auto still = warp_to_reference(pixels(image), answer);
    if (!still) {
      return;
    }
    auto message = std::make_unique<Image>();
    message->header = image.header;
    message->encoding = image.encoding;
    message->is_bigendian = image.is_bigendian;
    message->width = static_cast<unsigned int>(still->cols);
    message->height = static_cast<unsigned int>(still->rows);
    message->step = static_cast<unsigned int>(still->step);
    message->data.assign(still->datastart, still->dataend);
    warped_->publish(std::move(message));
  }

  std::size_t queue_;
  Pairing<Image, CameraInfo> pairing_;
  rclcpp::Publisher<Image>::SharedPtr warped_;
  rclcpp::Subscription<Image>::SharedPtr images_;
  rclcpp::Subscription<CameraInfo>::SharedPtr answers_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<WarpNode>());
  rclcpp::shutdown();
  return 0;
}
