// lumigrid-view runs in a window on a display of the test's own (Xvfb), whose pixels lie in a file.
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <thread>

#include "base/json/camera_file.h"
#include "tests/programs/published_site.h"

extern char** environ;

namespace {

using programs::readText;
using programs::run;
using programs::writeText;

constexpr int kWidth = 640, kHeight = 360;
constexpr const char* kXvfb = "/usr/bin/Xvfb";
constexpr const char* kXdotool = "/usr/bin/xdotool";

/// Runs Xvfb on a free display. Its pixels are undefined before a window is there.
class Display {
 public:
  explicit Display(const std::string& directory) : directory_(directory) {
    std::filesystem::create_directories(directory);
    // Xvfb takes a free display, and writes its number into a file.
    const std::string screen = std::to_string(kWidth) + "x" + std::to_string(kHeight) + "x24";
    pid_ = spawn({"/bin/sh", "-c",
                  std::string("exec ") + kXvfb + " -displayfd 1 -nocursor -nolisten tcp -screen 0 " + screen +
                      " -fbdir '" + directory + "' >'" + directory + "/number' 2>/dev/null"});
    for (int i = 0; i < 1000 && readText(directory + "/number").find('\n') == std::string::npos; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    const std::string number = readText(directory + "/number");
    ::setenv("DISPLAY", (":" + number.substr(0, number.find('\n'))).c_str(), 1);
  }
  ~Display() {
    ::kill(pid_, SIGTERM);
    programs::wait(pid_);
    ::unsetenv("DISPLAY");
  }
  Display(const Display&) = delete;
  Display& operator=(const Display&) = delete;

  /// Reads an XWD file of version 7: 25 numbers with the highest byte first, a name, colours, rows of BGRX.
  base::Image pixels() const {
    const std::string file = readText(directory_ + "/Xvfb_screen0");
    const auto word = [&](std::size_t i) {
      std::uint32_t value = 0;
      for (std::size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<std::uint8_t>(file[4 * i + k]);
      return std::size_t{value};
    };
    base::Image image(kWidth, kHeight, 4);
    const std::size_t begin = file.size() < 100 ? 0 : word(0) + 12 * word(19);
    const std::size_t row_bytes = file.size() < 100 ? 0 : word(12);
    if (begin + row_bytes * kHeight > file.size() || row_bytes == 0) return image;
    for (std::size_t y = 0; y < kHeight; ++y)
      for (std::size_t x = 0; x < kWidth; ++x)
        for (std::size_t k = 0; k < 3; ++k)
          image.pixels[4 * (y * kWidth + x) + k] =
              static_cast<std::uint8_t>(file[begin + y * row_bytes + 4 * x + 2 - k]);
    return image;
  }

  static void press(const std::string& key) { programs::wait(spawn({kXdotool, "key", key})); }

 private:
  static pid_t spawn(std::vector<std::string> words) {
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_t pid = -1;
    EXPECT_EQ(::posix_spawn(&pid, argv[0], nullptr, nullptr, argv.data(), environ), 0);
    return pid;
  }

  const std::string directory_;
  pid_t pid_ = -1;
};

class WindowTest : public programs::PublishedSite {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    if (!std::filesystem::exists(kXvfb)) GTEST_SKIP() << "no " << kXvfb << ": tools/install_packages.sh";
    scene_ = path("scene");
    ASSERT_EQ(run("lumigrid", {"sample", "--triangles", "40000", "-o", path("mesh.ply")}).status, 0);
    display_ = std::make_unique<Display>(path("display"));
  }
  void TearDown() override {
    close();
    display_.reset();
    PublishedSite::TearDown();
  }
  void build(const std::string& methods) {
    const auto built = run("lumigrid", {"build", path("mesh.ply"), "-o", scene_, "--methods", methods, "--quiet"});
    ASSERT_EQ(built.status, 0) << built.err;
    // The link and the path give one view with the same digits.
    makeTour(1, kWidth, kHeight);
    const nlohmann::json frame = nlohmann::json::parse(readText(path("tour.json")))["frames"][0];
    const auto& direction = frame["direction"];
    std::array<double, 3> p{};
    for (std::size_t k = 0; k < 3; ++k) p[k] = std::round(1e3 * frame["position"][k].get<double>()) / 1e3;
    const double heading = std::round(glm::degrees(std::atan2(direction[1].get<double>(), direction[0].get<double>())));
    const double pitch = std::round(glm::degrees(std::asin(direction[2].get<double>())));
    std::array<char, 200> link{};
    std::snprintf(link.data(), link.size(), "v=1&p=%.3f,%.3f,%.3f&a=%.0f,%.0f&r=1", p[0], p[1], p[2], heading, pitch);
    link_ = link.data();
    const double h = glm::radians(heading), t = glm::radians(pitch);
    const nlohmann::json view{{"frames",
                               {{{"position", p},
                                 {"direction", {std::cos(t) * std::cos(h), std::cos(t) * std::sin(h), std::sin(t)}},
                                 {"up", frame["up"]},
                                 {"fov_y_degrees", 45},
                                 {"width", kWidth},
                                 {"height", kHeight}}}}};
    writeText(path("tour.json"), view.dump());
  }
  /// Opens a window on the whole display; it logs to path("window.err").
  void open(const std::string& url, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{url, "--size", std::to_string(kWidth) + "x" + std::to_string(kHeight),
                                       "--background", "#203040"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    viewer_ = programs::start("lumigrid-view", arguments, path("window"));
  }
  void close() {
    if (viewer_ <= 0) return;
    ::kill(viewer_, SIGTERM);
    programs::wait(viewer_);
    viewer_ = -1;
  }
  /// Renders the view of link_ headless.
  base::Image headless(const std::string& url, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{url,  "--headless", "--background",    "#203040", "--settle",
                                       "60", "--path",     path("tour.json"), "--out",   path("headless")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto drawn = run("lumigrid-view", arguments);
    EXPECT_EQ(drawn.status, 0) << drawn.err;
    auto picture = base::readPng(path("headless/frame_0000.png"));
    EXPECT_TRUE(picture);
    return picture ? std::move(*picture) : base::Image();
  }
  bool waitFor(const std::function<bool(const base::Image&)>& wanted) const {
    for (int i = 0; i < 600; ++i) {
      if (wanted(display_->pixels())) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return false;
  }

  /// Waits until a program wrote the text: the server's log is written by a thread of its own.
  bool waitForLine(const std::string& file, const std::string& text) const {
    for (int i = 0; i < 600; ++i) {
      if (readText(path(file)).find(text) != std::string::npos) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return false;
  }

  std::unique_ptr<Display> display_;
  pid_t viewer_ = -1;
  std::string link_;
};

/// Counts pixels that differ in the rows where the window writes nothing: bars and toasts stand above and below.
int differing(const base::Image& a, const base::Image& b) {
  int different = 0;
  for (std::size_t y = 60; y < kHeight - 80; ++y)
    for (std::size_t x = 0; x < kWidth; ++x) {
      const std::size_t at = 4 * (y * kWidth + x);
      different += std::equal(&a.pixels[at], &a.pixels[at] + 3, &b.pixels[at]) ? 0 : 1;
    }
  return different;
}

/// Whether the picture shows a model before the background that open() asks for.
bool showsModel(const base::Image& image) {
  base::Image empty = image;
  for (std::size_t i = 0; i < empty.pixels.size(); i += 4)
    for (std::size_t k = 0; k < 3; ++k) empty.pixels[i + k] = static_cast<std::uint8_t>(0x20 + 0x10 * k);
  const int model = differing(image, empty);
  return model > 2000 && model < kWidth * (kHeight - 140) - 2000;
}

TEST_F(WindowTest, splatsAreThoseOfAHeadlessRunAndTheGlassIsDrawnOnThem) {
  build("patch,qsplat");
  const std::string url = serve(scene_).url;
  const base::Image expected = headless(url, {"--method", "qsplat"});
  ASSERT_TRUE(showsModel(expected));
  open(url, {"--no-settings", "--view", link_ + "&m=qsplat"});
  EXPECT_TRUE(waitFor([&](const base::Image& shown) { return differing(shown, expected) == 0; }))
      << differing(display_->pixels(), expected) << " pixels differ; " << readText(path("window.err"));

  if (!std::filesystem::exists(kXdotool)) GTEST_SKIP() << "no " << kXdotool << ": tools/install_packages.sh";
  // The glass has a rim, 0.18 of the view's height around its middle, and finer splats within.
  Display::press("l");
  EXPECT_TRUE(waitFor([&](const base::Image& shown) { return differing(shown, expected) > 200; }));
  Display::press("l");
  EXPECT_TRUE(waitFor([&](const base::Image& shown) { return differing(shown, expected) == 0; }));
}

TEST_F(WindowTest, recordsTheWayOfTheCameraWhichAHeadlessRunThenFollows) {
  build("patch");
  const std::string url = serve(scene_).url;
  open(url, {"--no-settings", "--view", link_, "--record", path("hand.json")});
  ASSERT_TRUE(waitFor(showsModel)) << readText(path("window.err"));
  const bool moves = std::filesystem::exists(kXdotool);
  // A busy machine may take longer than a press to notice it.
  for (int i = 0; i < 3; ++i) {
    if (moves) Display::press("Right");
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
  }
  close();
  const auto recorded = base::readCameraPath(path("hand.json"));
  ASSERT_TRUE(recorded) << recorded.error().message << readText(path("window.err"));
  const auto linked = base::readCameraPath(path("tour.json"));
  ASSERT_TRUE(linked);
  EXPECT_EQ(recorded->frames_per_second, 60.0);
  EXPECT_GE(recorded->seconds(), 0.5);
  EXPECT_LT(glm::length(recorded->frames.front().position - linked->frames.front().position), 1e-3);
  if (moves) {
    EXPECT_NE(recorded->frames.back().position, recorded->frames.front().position);
  }

  writeText(path("end.json"), base::formatCameraPath({{recorded->frames.back()}}));
  const auto drawn = run("lumigrid-view", {url, "--headless", "--path", path("end.json"), "--out", path("followed")});
  EXPECT_EQ(drawn.status, 0) << drawn.err;
  const auto refused = run("lumigrid-view", {url, "--headless", "--path", path("end.json"), "--record", "x.json"});
  EXPECT_EQ(refused.status, 2);
}

TEST_F(WindowTest, aSceneOfSplatsOnlyIsShownWithoutBeingAskedFor) {
  build("qsplat");
  open(serve(scene_).url, {"--no-settings"});
  EXPECT_TRUE(waitFor(showsModel)) << readText(path("window.err"));
}

TEST_F(WindowTest, theMethodIsThatOfTheSettingsAndPatchesStandInForSplatsThatAreNotThere) {
  build("patch,qsplat");
  std::filesystem::create_directories(path("config/lumigrid"));
  writeText(path("config/lumigrid/settings.json"), "{\"version\": 1, \"method\": \"qsplat\"}");
  ::setenv("XDG_CONFIG_HOME", path("config").c_str(), 1);
  open(serve(scene_).url, {});
  EXPECT_TRUE(waitFor(showsModel)) << readText(path("window.err"));
  close();
  const auto served = readText(path("serve0.err"));
  EXPECT_EQ(served.find("hello client"), std::string::npos) << "it spoke to the server of patches: " << served;

  ASSERT_EQ(run("lumigrid", {"build", path("mesh.ply"), "-o", path("plain"), "--methods", "patch", "--quiet"}).status,
            0);
  open(serve(path("plain")).url, {});
  EXPECT_TRUE(waitFor(showsModel)) << readText(path("window.err"));
  EXPECT_TRUE(waitForLine("serve1.err", "hello client")) << readText(path("serve1.err"));
  ::unsetenv("XDG_CONFIG_HOME");
}

}  // namespace
