// Tests a published scene behind a real web server, as the window opens it.
#include "client/native/published_scene.h"

#include <gtest/gtest.h>

#include <fstream>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "client/native/host_probe.h"
#include "lod/patch/group_records.h"
#include "lod/patch/ray_cast.h"
#include "tests/server/session/memory_store.h"
#include "tests/support/nginx.h"

namespace client {
namespace {

/// Publishes a scene of patches only, at kOrigin in the world.
const glm::dvec3 kOrigin{500'000.25, 4'000'000.5, 100.0};
void publish(const server::TestScene& from, const support::TemporaryDirectory& to) {
  const std::string id = "-0123456789abcdef0123456789abcdef";
  const std::string patches = "patch" + id + ".lgp", records = "records" + id + ".lgr";
  const auto bytes = base::readFile(from.path);
  ASSERT_TRUE(bool(bytes));
  const auto write = [&](const std::string& name, const base::Bytes& content) {
    std::ofstream(to / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(content.data()), static_cast<std::streamsize>(content.size()));
  };
  write(patches, *bytes);
  const base::Bytes of_groups = lod::patch::encodeRecords(from.patches->hierarchy(), bytes->size());
  write(records, of_groups);
  base::Scene scene;
  scene.sources.push_back({"synthetic.ply", 1, std::string(64, 'a')});
  scene.origin = kOrigin;
  scene.box_min = kOrigin + glm::dvec3(from.data.welcome.box_min);
  scene.box_max = kOrigin + glm::dvec3(from.data.welcome.box_max);
  scene.units = "m";
  scene.parts.push_back({patches, bytes->size(), std::string(64, 'b')});
  scene.parts.push_back({records, of_groups.size(), std::string(64, 'c'), {{0, of_groups.size()}}});
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
  ASSERT_TRUE(until([&] { return session.phase() == SessionPhase::kReady; })) << session.problem();

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

// ---- what a host must send (docs/hosting.md) ----

/// Runs the document's nginx over this folder, behind a proxy of the same kind that may drop headers.
class HostCheckTest : public testing::Test {
 protected:
  void SetUp() override {
    LUMIGRID_SKIP_WITHOUT_NGINX();
    publish(scene_, folder_);
    const auto bytes = base::readFile(LUMIGRID_SOURCE_DIR "/docs/hosting.md");
    ASSERT_TRUE(bytes);
    const std::string document(bytes->begin(), bytes->end());
    const std::string fence = "```nginx\n";
    const std::size_t begin = document.find(fence) + fence.size();
    snippet_ = document.substr(begin, document.find("```", begin) - begin);
    support::replaceAll(snippet_, "listen 8088;", "listen 127.0.0.1:$PORT0;");
    support::replaceAll(snippet_, "root /srv/lumigrid;", "root " + folder_.path() + ";");
  }
  std::vector<HostFinding> findings(const std::string& http, std::size_t port = 0) const {
    const support::Nginx nginx(support::Nginx::Configuration{http, port + 1});
    const auto answers = askHost("http://127.0.0.1:" + std::to_string(nginx.port(port)) + "/");
    EXPECT_TRUE(bool(answers)) << answers.error().message;
    return answers ? judgeHost(*answers) : std::vector<HostFinding>();
  }
  /// Returns the snippet with `from` replaced.
  std::string changed(const std::string& from, const std::string& to) const {
    std::string http = snippet_;
    EXPECT_NE(http.find(from), std::string::npos) << "docs/hosting.md lacks '" << from << "'";
    support::replaceAll(http, from, to);
    return http;
  }
  static const HostFinding* about(const std::vector<HostFinding>& findings, const std::string& header) {
    for (const HostFinding& one : findings)
      if (one.header == header && one.grade != HostFinding::Grade::kGood) return &one;
    return nullptr;
  }

  const server::TestScene scene_;
  const support::TemporaryDirectory folder_;
  std::string snippet_;
};

TEST_F(HostCheckTest, theDocumentsNginxLacksNothing) {
  const auto all = findings(snippet_);
  EXPECT_EQ(all.size(), 9U);
  for (const HostFinding& one : all)
    EXPECT_EQ(one.grade, HostFinding::Grade::kGood) << one.header << ": " << one.message;
}

// Each header is removed in turn; the check must name it, and the line that it prints must repair it.
TEST_F(HostCheckTest, eachHeaderTakenAwayIsNamedAndTheLineToldMendsIt) {
  struct Case {
    const char* header;
    HostFinding::Grade grade;
    const char* from;  // text of the document's snippet that is removed
    const char* to;
    const char* rest = "";  // rest of the line that stays when it is repaired
  };
  using Grade = HostFinding::Grade;
  const Case cases[] = {
      {"Range", Grade::kFails, "max_ranges 1;", "max_ranges 0;"},
      {"Range", Grade::kFails, "gzip off;", "gzip on; gzip_types *; gzip_min_length 0;"},
      {"ETag", Grade::kSlow, "sendfile on;", "sendfile on; etag off;", "sendfile on;"},
      {"Access-Control-Allow-Origin", Grade::kSlow, "add_header Access-Control-Allow-Origin \"*\" always;", ""},
      {"Access-Control-Allow-Headers", Grade::kSlow,
       "add_header Access-Control-Allow-Headers \"Range, If-Range\" always;", ""},
      {"Access-Control-Allow-Headers", Grade::kSlow, "if ($request_method = OPTIONS) { return 204; }", ""},
      {"Access-Control-Expose-Headers", Grade::kSlow,
       "add_header Access-Control-Expose-Headers \"Content-Length, Content-Range, ETag\" always;", ""},
      {"Cache-Control", Grade::kSlow, "add_header Cache-Control $lumigrid_cache;", ""},
      {"Cache-Control", Grade::kSlow, "default                          \"no-cache\";", "default \"immutable\";"}};
  for (const Case& one : cases) {
    const auto found = findings(changed(one.from, one.to));
    const HostFinding* finding = about(found, one.header);
    ASSERT_NE(finding, nullptr) << one.from;
    EXPECT_EQ(finding->grade, one.grade) << finding->message;
    ASSERT_FALSE(finding->nginx.empty());
    if (std::string(one.from).find("default") == 0) continue;  // the line is present, only its table is wrong

    // The line replaces the wrong one, since nginx accepts no directive twice.
    const auto mended = findings(changed(one.from, one.rest + finding->nginx));
    EXPECT_EQ(about(mended, one.header), nullptr) << finding->nginx;
  }
}

TEST_F(HostCheckTest, namesHeadersThatAProxyDrops) {
  const auto behind = [&](const std::string& lines) {
    return snippet_ + "server {\nlisten 127.0.0.1:$PORT1;\nlocation / {\nproxy_pass http://127.0.0.1:$PORT0;\n" +
           lines + "\n}\n}\n";
  };
  struct Case {
    const char* header;
    HostFinding::Grade grade;
    const char* lines;
  };
  const Case cases[] = {{"Accept-Ranges", HostFinding::Grade::kSlow, "proxy_hide_header Accept-Ranges;"},
                        {"Content-Range", HostFinding::Grade::kFails, "proxy_hide_header Content-Range;"},
                        {"Range", HostFinding::Grade::kFails, "proxy_set_header Range \"\";"}};
  EXPECT_EQ(findings(behind(""), 1).size(), 9U);
  for (const Case& one : cases) {
    const auto found = findings(behind(one.lines), 1);
    const HostFinding* finding = about(found, one.header);
    ASSERT_NE(finding, nullptr) << one.lines;
    EXPECT_EQ(finding->grade, one.grade) << finding->message;
    EXPECT_FALSE(finding->nginx.empty());
  }
}

}  // namespace
}  // namespace client
