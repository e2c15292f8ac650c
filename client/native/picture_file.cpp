#include "client/native/picture_file.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>

#include "base/format_text.h"

namespace client {

std::string pictureName(const std::string& scene) {
  std::string name = "lumigrid-";
  for (const char c : scene.substr(0, 64)) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    name += plain ? c : '-';
  }
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  ::localtime_r(&now, &local);
  std::array<char, 32> time{};
  std::strftime(time.data(), time.size(), "-%Y%m%d-%H%M%S", &local);
  return name + time.data() + ".png";
}

std::string freePath(const std::string& directory, const std::string& name) {
  const std::filesystem::path folder(directory);
  const std::filesystem::path file(name);
  std::error_code error;
  std::filesystem::path path = folder / file;
  for (int i = 2; std::filesystem::exists(path, error) && i < 1000; ++i)
    path = folder / (file.stem().string() + "-" + std::to_string(i) + file.extension().string());
  return path.string();
}

std::string renderTarget(const Request& request, const std::array<float, 4>& background) {
  const auto byte = [](float share) {
    return static_cast<unsigned>(std::lround(255.0F * std::clamp(share, 0.0F, 1.0F)));
  };
  return "/render?" + request.text +
         base::formatText("&width=%d&height=%d&background=%02x%02x%02x", request.camera.width, request.camera.height,
                          byte(background[0]), byte(background[1]), byte(background[2]));
}

}  // namespace client
