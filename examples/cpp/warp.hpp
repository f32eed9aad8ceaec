// From messages to a stabilised image. Needs the headers of sensor_msgs and OpenCV, and no ROS node.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <sensor_msgs/image_encodings.hpp>
#include <sensor_msgs/msg/camera_info.hpp>
#include <sensor_msgs/msg/image.hpp>

/// The pixels of a mono or colour image of 8 or 16 bit, shared with the message.
inline cv::Mat pixels(const sensor_msgs::msg::Image & message)
{
  namespace encodings = sensor_msgs::image_encodings;
  const auto & encoding = message.encoding;
  if (!encodings::isMono(encoding) && !encodings::isColor(encoding)) {
    throw std::invalid_argument("encoding " + encoding + ": neither mono nor colour");
  }
  const int depth = encodings::bitDepth(encoding) == 8 ? CV_8U : CV_16U;
  return cv::Mat(
    static_cast<int>(message.height), static_cast<int>(message.width),
    CV_MAKETYPE(depth, encodings::numChannels(encoding)), const_cast<unsigned char *>(message.data.data()), message.step);
}

/// The image in the place of the reference, black beyond its border; nothing while it is lost.
///
/// H = P[:,:3] R K^-1 maps centres of pixels; that of the top left one is (0, 0), as in OpenCV, so nothing is to be added.
/// With `use_camera_info` of the tracker, H is that of undistorted pixels, and D the distortion.
inline std::optional<cv::Mat> warp_to_reference(const cv::Mat & image, const sensor_msgs::msg::CameraInfo & answer)
{
  const cv::Matx33d K(answer.k.data());
  const cv::Matx33d R(answer.r.data());
  const cv::Matx33d P = cv::Matx34d(answer.p.data()).get_minor<3, 3>(0, 0);
  const cv::Size size(static_cast<int>(answer.width), static_cast<int>(answer.height));
  if (K(0, 0) == 0) {
    return std::nullopt;
  }
  // the tracker writes 1e-300 where there is no distortion: at 0, image_proc would pass frames through
  const auto is_none = [](double value) {return std::abs(value) < 1e-200;};
  cv::Mat warped;
  if (std::all_of(answer.d.begin(), answer.d.end(), is_none)) {
    cv::warpPerspective(image, warped, P * R * K.inv(), size);
    return warped;
  }
  cv::Mat x_px;
  cv::Mat y_px;
  if (answer.distortion_model == "equidistant") {
    cv::fisheye::initUndistortRectifyMap(K, answer.d, R, P, size, CV_32FC1, x_px, y_px);
  } else {
    cv::initUndistortRectifyMap(K, answer.d, R, P, size, CV_32FC1, x_px, y_px);
  }
  cv::remap(image, warped, x_px, y_px, cv::INTER_LINEAR);
  return warped;
}
