// Each file of a scene is cut while it is served. The server lives, other scenes are served as before, and what is
// damaged is answered with errors (docs/decisions/reads-that-cannot-kill.md).
#include <signal.h>

#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include "protocol/parts.h"
#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace {

namespace fs = std::filesystem;
using programs::run;
using server::httpRequest;
using server::LoopbackClient;

constexpr const char* kWhole = "whole";
constexpr const char* kRender = "/render?position=10,6,20&direction=0,0,-1&width=64&height=64&supersampling=1";
constexpr const char* kPick = "/pick?ox=10.3&oy=6.2&oz=20&dx=0&dy=0&dz=-1";

/// The messages that a viewer was sent for a view, each as its bytes.
struct Answer {
  std::set<base::Bytes> groups, faces;
  bool is_complete = false;

  bool isPartOf(const Answer& other) const {
    return std::includes(other.groups.begin(), other.groups.end(), groups.begin(), groups.end()) &&
           std::includes(other.faces.begin(), other.faces.end(), faces.begin(), faces.end());
  }
};

class Viewer {
 public:
  Viewer(std::uint16_t port, const std::string& scene) : client_(LoopbackClient::connect(port, "/" + scene + "/")) {
    if (!client_ || !client_->send(protocol::Hello{protocol::kVersion, "test"})) return;
    if (const auto message = client_->receive())
      if (const auto* welcome = std::get_if<protocol::Welcome>(&*message)) welcome_ = *welcome;
  }

  Answer look() {
    Answer answer;
    if (!client_ || !welcome_ || !client_->send(server::viewOf(*welcome_, ++sequence_))) return answer;
    while (!answer.is_complete) {
      auto message = client_->receive();
      if (!message) break;
      if (const auto* part = std::get_if<protocol::Part>(&*message)) {
        const auto whole = parts_.accept(*part);
        if (!whole || !*whole) continue;
        message = *protocol::decodeServerMessage(**whole);
      }
      accept(*message, answer);
    }
    return answer;
  }

 private:
  void accept(const protocol::ServerMessage& message, Answer& answer) const {
    if (std::holds_alternative<protocol::Refinement>(message)) answer.groups.insert(protocol::encode(message));
    if (std::holds_alternative<protocol::Face>(message)) answer.faces.insert(protocol::encode(message));
    const auto* complete = std::get_if<protocol::Completion>(&message);
    answer.is_complete = complete != nullptr && complete->sequence == sequence_;
  }

  std::unique_ptr<LoopbackClient> client_;
  std::optional<protocol::Welcome> welcome_;
  protocol::PartReceiver parts_;
  std::uint32_t sequence_ = 0;
};

class CutFiles : public programs::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    done({"sample", "--shape", "facade", "--triangles", "20000", "--texels", "50", "-o", path("wall.obj")});
    done({"build", path("wall.obj"), "-o", path("built"), "--methods", "patch,images,qsplat", "--grid", "3", "--face",
          "64", "--quiet"});
    done({"publish", path("built"), path("published"), "--quiet", "--viewer", "off", "--with-textures"});
    for (const char* scene : {"built", "published"})
      programs::writeText(path(scene) + std::string("/annotations.json"), R"({"version": 1, "annotations": []})");
  }
  void TearDown() override {
    if (server_ > 0) stop();
    ProgramTest::TearDown();
  }
  static void done(const std::vector<std::string>& arguments) {
    const auto outcome = run("lumigrid", arguments);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }

  void serve(const std::vector<std::string>& scenes) {
    std::vector<std::string> arguments{"serve"};
    arguments.insert(arguments.end(), scenes.begin(), scenes.end());
    arguments.insert(arguments.end(), {"--port", "0", "--json", "--access-interval", "1"});
    fs::remove(path("serve.out"));
    server_ = programs::start("lumigrid", arguments, path("serve"));
    port_ = 0;
    for (int i = 0; i < 6000 && port_ == 0; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      const auto said = nlohmann::json::parse(programs::readText(path("serve.out")), nullptr, false);
      if (said.is_object()) port_ = said["port"];
    }
    ASSERT_NE(port_, 0) << programs::readText(path("serve.err"));
  }
  void stop() {
    ::kill(server_, SIGTERM);
    EXPECT_EQ(programs::wait(std::exchange(server_, 0)), 0) << programs::readText(path("serve.err"));
  }

  server::HttpAnswer get(const std::string& scene, const std::string& target,
                         const std::map<std::string, std::string>& headers = {}) const {
    return httpRequest(port_, "/" + scene + target, headers);
  }

  /// The names of a scene's files that have bytes, after a viewer was there.
  std::vector<std::string> filesOf(const std::string& scene) {
    serve({path(scene), path(kWhole)});
    EXPECT_TRUE(Viewer(port_, scene).look().is_complete);
    stop();
    std::vector<std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(path(scene)))
      if (entry.is_regular_file() && entry.file_size() > 0)
        files.push_back(fs::relative(entry.path(), path(scene)).string());
    return files;
  }

  /// "patch.lgp", or its published name.
  std::string patchFile(const std::string& scene) const {
    return *base::partFile(*base::readScene(path(scene)), "patch", ".lgp");
  }

  struct Case {
    std::string scene;  ///< a copy whose one file is cut while it is served
    std::string file;
    std::unique_ptr<Viewer> viewer;  ///< who came before
  };
  void expectErrorsOnly(Case& one, const Answer& whole);
  void expectDownloads(const Case& one, const std::string& target);
  void cutEachFile(const std::string& original, bool to_nothing);

  std::uint16_t port_ = 0;
  pid_t server_ = 0;
};

// Bytes that come are right, and what cannot be read is an error or ends the connection.
void CutFiles::expectDownloads(const Case& one, const std::string& target) {
  const std::string whole = get(kWhole, target).body;
  ASSERT_GT(whole.size(), 100U);
  const auto answer = get(one.scene, target);
  EXPECT_TRUE(answer.status == 200 || answer.status == 503 || answer.status == 0) << target << " " << answer.status;
  EXPECT_TRUE(answer.status != 200 || answer.body == whole) << target;
  const auto last = get(one.scene, target, {{"Range", "bytes=-16"}});
  EXPECT_TRUE(last.status == 206 || last.status == 503) << target << " " << last.status;
  EXPECT_TRUE(last.status != 206 || last.body == whole.substr(whole.size() - 16)) << target;
  const std::string stem = fs::path(target).stem();
  const bool is_cut = one.file.starts_with(stem + ".") || one.file.starts_with(stem + "-");
  EXPECT_TRUE(!is_cut || last.status == 503) << target << " " << last.status;
  EXPECT_TRUE(last.status != 503 || last.body.find('\n') == last.body.size() - 1) << last.body;
}

void CutFiles::expectErrorsOnly(Case& one, const Answer& whole) {
  const Answer seen = one.viewer->look();
  EXPECT_TRUE(seen.is_complete);
  EXPECT_TRUE(seen.isPartOf(whole)) << "something damaged was sent";
  const Answer later = Viewer(port_, one.scene).look();
  EXPECT_TRUE(later.is_complete);
  EXPECT_TRUE(later.isPartOf(whole)) << "something damaged was sent";
  expectDownloads(one, "/patch.lgp");
  expectDownloads(one, "/qsplat.lgq");
  for (const char* target : {"/scene.json", "/annotations.json"}) EXPECT_EQ(get(one.scene, target).status, 200);
  const auto ok = [](int status) { return status == 200 || status == 503; };
  EXPECT_TRUE(ok(get(one.scene, kRender).status)) << get(one.scene, kRender).status;
  EXPECT_TRUE(ok(get(one.scene, kPick).status)) << get(one.scene, kPick).status;
  EXPECT_EQ(httpRequest(port_, "/healthz").status, 200);
}

void CutFiles::cutEachFile(const std::string& original, bool to_nothing) {
  fs::remove_all(path(kWhole));
  fs::copy(path(original), path(kWhole), fs::copy_options::recursive);
  std::vector<Case> cases;
  std::vector<std::string> scenes{path(kWhole)};
  for (const std::string& file : filesOf(original)) {
    cases.push_back({original + std::to_string(cases.size()), file, nullptr});
    scenes.push_back(path(cases.back().scene));
    fs::remove_all(scenes.back());
    fs::copy(path(original), scenes.back(), fs::copy_options::recursive);
  }
  ASSERT_GE(cases.size(), 6U);
  serve(scenes);
  const Answer whole = Viewer(port_, kWhole).look();
  ASSERT_TRUE(whole.is_complete);
  ASSERT_GE(whole.groups.size(), 3U);
  ASSERT_GE(whole.faces.size(), 3U);
  const std::string picture = get(kWhole, kRender).body;
  const std::string hit = get(kWhole, kPick).body;
  ASSERT_GT(picture.size(), 100U);
  for (Case& one : cases) one.viewer = std::make_unique<Viewer>(port_, one.scene);

  for (const Case& one : cases) {
    const fs::path file = fs::path(path(one.scene)) / one.file;
    fs::resize_file(file, to_nothing ? 0 : fs::file_size(file) / 2);
  }
  for (Case& one : cases) {
    SCOPED_TRACE(one.file + (to_nothing ? " cut to nothing" : " cut to a half"));
    expectErrorsOnly(one, whole);
  }

  const Answer again = Viewer(port_, kWhole).look();
  EXPECT_TRUE(again.is_complete);
  EXPECT_TRUE(again.groups == whole.groups);
  EXPECT_TRUE(again.faces == whole.faces);
  EXPECT_TRUE(get(kWhole, kRender).body == picture);
  EXPECT_EQ(get(kWhole, kPick).body, hit);
  EXPECT_EQ(get(kWhole, "/patch.lgp").body.size(), fs::file_size(path(kWhole) + "/" + patchFile(original)));
  stop();
  const std::string log = programs::readText(path("serve.err"));
  EXPECT_NE(log.find(patchFile(original) + ": ends at byte"), std::string::npos) << log;
  EXPECT_NE(log.find("failed since the server began"), std::string::npos) << log;
  EXPECT_EQ(log.find("scene " + std::string(kWhole) + " failed"), std::string::npos) << log;
  const bool names_store = log.find("images/data.mdb: a read failed: the file was cut or the disk fails") != log.npos;
  EXPECT_EQ(names_store, original == "built") << log;
}

TEST_F(CutFiles, ofABuiltSceneLeaveTheServerAndOtherScenesAlone) {
  for (const bool to_nothing : {false, true}) cutEachFile("built", to_nothing);
}

TEST_F(CutFiles, ofAPublishedSceneLeaveTheServerAndOtherScenesAlone) {
  for (const bool to_nothing : {false, true}) cutEachFile("published", to_nothing);
}

}  // namespace
