#pragma once
// A viewer of a method's streamed file, without a network and without a window.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "base/egl/headless.h"
#include "base/gl/gl.h"
#include "client/viewer/viewer.h"
#include "tests/support/range_host.h"

namespace support {

/// `Streamed`: a client::StreamedView.
template <class Streamed>
class StreamedViewer : public ::testing::Test {
 protected:
  static constexpr int kSize = 256;

  void SetUp() override {
    auto made = base::HeadlessContext::create();
    if (!made) GTEST_SKIP() << made.error().message;
    context_ = std::move(*made);
    auto target = base::gl::RenderTarget::create(kSize, kSize);
    ASSERT_TRUE(bool(target));
    target_ = std::move(*target);
  }

  /// Shows a file of this name that a host has. `make`: makes the view from its place, the scene's Welcome and the
  /// fetcher. `reach`: half the edge of the scene's box.
  template <class Make>
  void openAtHost(client::ViewerOptions viewer, const std::string& name, const base::Bytes& bytes, float reach,
                  const Make& make) {
    auto host = std::make_unique<RangeHost>(name, bytes);
    host_ = host.get();
    protocol::Welcome welcome;
    welcome.scene_name = "scene";
    welcome.box_min = glm::vec3(-reach);
    welcome.box_max = glm::vec3(reach);
    show(std::move(viewer), make(client::FilePlace{"http://host/scene", name, bytes.size()}, welcome, std::move(host)));
  }
  void show(client::ViewerOptions viewer, std::shared_ptr<Streamed> streamed) {
    viewer_ = std::make_unique<client::Viewer>(std::move(viewer), std::make_unique<NoDecoder>());
    streamed_ = std::move(streamed);
    viewer_->setStreamed(streamed_);
  }

  /// A view of the origin, turned around the y axis, radians.
  static base::ViewCamera viewFrom(double turn, double distance) {
    base::ViewCamera camera;
    camera.position = {distance * std::sin(turn), 0.0, distance * std::cos(turn)};
    camera.direction = -glm::normalize(camera.position);
    camera.width = camera.height = kSize;
    return camera;
  }
  void pump() { streamed_->pump(viewer_->session(), now_ += 0.02); }
  base::Image draw(const base::ViewCamera& camera) {
    target_.bind();
    EXPECT_TRUE(bool(viewer_->draw(camera, now_)));
    EXPECT_EQ(base::gl::takeError(), "");
    return client::readPicture(target_, *viewer_);
  }
  void fetchAll(const base::ViewCamera& camera) {
    ASSERT_TRUE(bool(viewer_->update(camera, now_)));
    for (int i = 0; i < 5000 && !viewer_->allHere(); ++i) {
      pump();
      ASSERT_TRUE(bool(viewer_->update(camera, now_)));
    }
    ASSERT_TRUE(viewer_->allHere());
  }
  /// Each frame takes twice the time that it may.
  static void makeLate(client::StreamedOptions& options, double& clock) {
    options.clock = [&clock] { return clock += 0.2; };
    options.frame_seconds = 0.1;
  }

  std::unique_ptr<base::HeadlessContext> context_;
  base::gl::RenderTarget target_;
  std::unique_ptr<client::Viewer> viewer_;
  std::shared_ptr<Streamed> streamed_;
  RangeHost* host_ = nullptr;
  double now_ = 0.0;
};

}  // namespace support
