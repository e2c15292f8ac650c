// A published scene behind a real web server, as the window has it.
#include "client/native/published_scene.h"

#include <gtest/gtest.h>

#include <fstream>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "lod/patch/ray_cast.h"
#include "tests/server/session/memory_store.h"
#include "tests/support/nginx.h"

namespace client {
namespace {

/// Patches alone, at kOrigin in the world.
const glm::dvec3 kOrigin{500'000.25, 4'000'000.5, 100.0};
void publish(const server::TestScene& from, const support::TemporaryDirectory& to) {
  const std::string patches = "patch-0123456789abcdef0123456789abcdef.lgp";
  const auto bytes = base::readFile(from.path);
  ASSERT_TRUE(bool(bytes));
  std::ofstream(to / patches, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes->data()), static_cast<std::streamsize>(bytes->size()));
  base::Scene scene;
  scene.sources.push_back({"synthetic.ply", 1, std::string(64, 'a')});
  scene.origin = kOrigin;
  scene.box_min = kOrigin + glm::dvec3(from.data.welcome.box_min);
  scene.box_max = kOrigin + glm::dvec3(from.data.welcome.box_max);
  scene.units = "m";
  scene.parts.push_back({patches, bytes->size(), std::string(64, 'b')});
  std::ofstream(to / "scene.json") << base::formatScene(scene);
}

TEST(PublishedScene, aPickReadsTheTrueSurfaceFromAPlainWebServer) {
  LUMIGRID_SKIP_WITHOUT_NGINX();
  const server::TestScene scene(32);
  const support::TemporaryDirectory folder;
  publish(scene, folder);
  const support::Nginx nginx(folder.path());
  PublishedSceneLink link(nginx.url() + "/");
  Session session({});
  const auto until = [&](const std::function<bool()>& done) {
    for (int i = 0; i < 2000 && !done(); ++i) {
      link.pump(session);
      if (!done()) link.waitForArrival(0.01);
    }
    return done();
  };
  ASSERT_TRUE(until([&] { return session.state() == SessionState::kReady; })) << session.problem();

  lod::patch::Ray ray;
  ray.origin = kOrigin + scene.center() + glm::dvec3(3.25, -2.5, 40.0);
  ray.direction = {0.02, 0.01, -1.0};
  ASSERT_TRUE(link.pick(7, ray.origin, ray.direction));
  std::vector<AnsweredPick> answers;
  ASSERT_TRUE(until([&] { return !(answers = answers.empty() ? link.takePicks() : answers).empty(); }));
  EXPECT_EQ(answers[0].id, 7U);

  ray.origin -= kOrigin;
  const auto truth = lod::patch::castRay(scene.patches->hierarchy(), ray, lod::patch::blocksOf(*scene.patches));
  ASSERT_TRUE(truth && truth->hit);
  ASSERT_EQ(answers[0].answer.kind, PickAnswer::Kind::kHit);
  EXPECT_LT(glm::length(answers[0].answer.point - (kOrigin + truth->hit->point)), 1e-9);
  EXPECT_EQ(answers[0].answer.accuracy, scene.patches->hierarchy().lattice.step);
  EXPECT_EQ(nginx.accessLog().find("/pick"), std::string::npos);
}

}  // namespace
}  // namespace client
