// Pairs and warps messages with the headers of examples/cpp: pair_and_warp QUEUE OUTPUT image_N homography_N ...
// The files hold messages as they are on the wire, in the order of arrival; OUTPUT gets STAMP_NS.raw for each pair.

#include <cstdint>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <sensor_msgs/msg/detail/camera_info__rosidl_typesupport_fastrtps_cpp.hpp>
#include <sensor_msgs/msg/detail/image__rosidl_typesupport_fastrtps_cpp.hpp>

#include "pairing.hpp"
#include "warp.hpp"

using sensor_msgs::msg::CameraInfo;
using sensor_msgs::msg::Image;

template <class Message>
std::shared_ptr<const Message> read(const std::string & path)
{
  std::ifstream file(path, std::ios::binary);
  std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  eprosima::fastcdr::FastBuffer buffer(bytes.data(), bytes.size());
  eprosima::fastcdr::Cdr cdr(buffer);
  cdr.read_encapsulation();
  auto message = std::make_shared<Message>();
  sensor_msgs::msg::typesupport_fastrtps_cpp::cdr_deserialize(cdr, *message);
  return message;
}

int main(int argc, char ** argv)
{
  const std::string output = argv[2];
  Pairing<Image, CameraInfo> pairing(std::stoul(argv[1]), [&](const Image & image, const CameraInfo & answer) {
    if (const auto warped = warp_to_reference(pixels(image), answer)) {
      const auto & stamp = image.header.stamp;
      const auto stamp_ns = stamp.sec * std::int64_t{1000000000} + stamp.nanosec;
      std::ofstream file(output + "/" + std::to_string(stamp_ns) + ".raw", std::ios::binary);
      file.write(reinterpret_cast<const char *>(warped->data), static_cast<std::streamsize>(warped->total()));
    }
  });
  for (int i = 3; i < argc; ++i) {
    const std::string path = argv[i];
    if (path.find("/image_") != std::string::npos) {
      pairing.add(read<Image>(path));
    } else {
      pairing.add(read<CameraInfo>(path));
    }
  }
  return 0;
}
