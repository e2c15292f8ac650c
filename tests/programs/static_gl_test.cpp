// The thin client reads a published scene from nginx, with no server of ours.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <regex>
#include <sstream>

#include "tests/programs/published_site.h"
#include "tests/support/byte_ranges.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using programs::Tour;

constexpr int kFrames = 4;

class StaticScene : public programs::PublishedSite {
 protected:
  void SetUp() override {
    PublishedSite::SetUp();
    if (IsSkipped()) return;
    makeTour(kFrames, 320, 180);
  }
  programs::Outcome view(const std::string& url) {
    return run("lumigrid-view", {url, "--headless", "--path", path("tour.json"), "--connect-timeout", "3"});
  }
  std::string objectOf(const std::string& extension) const {
    for (const auto& entry : fs::recursive_directory_iterator(path("site/tower")))
      if (entry.path().extension() == extension) return entry.path().string();
    return "";
  }
};

// Parses lines "status bytes range uri".
support::ByteRanges rangesOf(const std::string& log) {
  support::ByteRanges ranges;
  const std::regex line("206 \\d+ bytes=(\\d+)-(\\d+) (\\S+)");
  for (std::sregex_iterator it(log.begin(), log.end(), line), end; it != end; ++it)
    ranges[(*it)[3]].emplace_back(std::stoull((*it)[1]), std::stoull((*it)[2]) + 1);
  return ranges;
}

// Images come in another order, so that a blend may differ in its last digit.
void expectAlike(const Tour& a, const Tour& b) {
  ASSERT_EQ(a.pictures.size(), b.pictures.size());
  for (std::size_t i = 0; i < a.pictures.size(); ++i) {
    const auto& p = a.pictures[i].pixels;
    const auto& q = b.pictures[i].pixels;
    ASSERT_EQ(p.size(), q.size());
    double sum = 0.0;
    std::size_t outliers = 0;
    for (std::size_t k = 0; k < p.size(); ++k) {
      const int difference = std::abs(int{p[k]} - int{q[k]});
      sum += difference;
      outliers += difference > 8 ? 1 : 0;
    }
    EXPECT_LT(sum / static_cast<double>(p.size()), 0.5) << "frame " << i;
    EXPECT_LT(outliers, p.size() / 100) << "frame " << i;
  }
}

TEST_F(StaticScene, nginxAloneShowsWhatAServerShows) {
  const support::Nginx nginx(support::Nginx::Configuration{
      "log_format ranges '$status $body_bytes_sent $http_range $uri';\nserver {\nlisten 127.0.0.1:$PORT0;\nroot " +
      path("site") + ";\naccess_log " + path("ranges.log") + " ranges;\n}\n"});
  const Tour alone = tour(nginx.url() + "/tower/", "static");
  const Tour with_server = tour(serve(scene_).url, "served");
  expectAlike(alone, with_server);
  ASSERT_EQ(alone.lines.size(), with_server.lines.size());
  for (std::size_t i = 0; i < alone.lines.size(); ++i) {
    EXPECT_EQ(alone.lines[i]["triangles"], with_server.lines[i]["triangles"]);
    // Spheres from files are rounded outwards, so the same cut is told to be at least as far off.
    const double told = alone.lines[i]["error_px"].get<double>();
    const double by_server = with_server.lines[i]["error_px"].get<double>();
    EXPECT_GE(told, by_server);
    EXPECT_LE(told, 1.02 * by_server);
  }

  // The requests and bytes, by nginx's own log.
  const std::string log = readText(path("ranges.log"));
  EXPECT_EQ(support::bytesRepeated(rangesOf(log)), 0U) << log;
  std::istringstream lines(log);
  std::size_t requests = 0;
  for (std::string line; std::getline(lines, line); ++requests)
    EXPECT_TRUE(line.rfind("206 ", 0) == 0 || line.find("/tower/scene.json") != std::string::npos) << line;
  const json& last = alone.lines.back()["link"];
  EXPECT_LE(last["requests"].get<std::size_t>(), requests) << "frames.jsonl counts up to the last picture";
  EXPECT_GT(last["requests"].get<std::size_t>(), 4U);
  std::uint64_t before = 0;
  for (const json& line : alone.lines) {
    const auto bytes = line["link"]["bytes"].get<std::uint64_t>();
    std::printf("frame %d: %llu requests, %llu bytes so far\n", line["frame"].get<int>(),
                static_cast<unsigned long long>(line["link"]["requests"].get<std::uint64_t>()),
                static_cast<unsigned long long>(bytes));
    EXPECT_GE(bytes, before);
    before = bytes;
  }

  // The address of scene.json serves as well.
  expectAlike(tour(nginx.url() + "/tower/scene.json", "by_name"), alone);
}

TEST_F(StaticScene, aHostThatCannotIsNamedWithWhatToDo) {
  // The host knows no ranges, has no such folder, forbids it, or compresses.
  const support::Nginx nginx(path("site"),
                             "location /tower/ { }\n"
                             "location /whole/ { alias " +
                                 path("site/tower") +
                                 "/; max_ranges 0; }\n"
                                 "location /secret/ { deny all; }\n");
  expectOneLineError(view(nginx.url() + "/whole/"), 1, {"/whole/", "ignores Range", "docs/hosting.md"});
  expectOneLineError(view(nginx.url() + "/nothing/"), 1, {"/nothing/scene.json", "is not there", "404"});
  expectOneLineError(view(nginx.url() + "/secret/"), 1, {"/secret/scene.json", "may not be read", "403"});
  expectOneLineError(view("http://127.0.0.1:1/tower/"), 1, {"no answer", "check the network"});
  EXPECT_EQ(view("https://").status, 2);

  // The place holds a built scene, and one that lost its hierarchy.
  const std::string patches = objectOf(".lgp");
  fs::copy(scene_, path("site/tower/built"), fs::copy_options::recursive);
  expectOneLineError(view(nginx.url() + "/tower/built/"), 1, {"lumigrid publish"});
  fs::copy(path("site/tower"), path("site/lost"), fs::copy_options::recursive);
  for (const auto& entry : fs::directory_iterator(path("site/lost")))
    if (entry.path().extension() == ".lgp") fs::remove(entry.path());
  expectOneLineError(view(nginx.url() + "/lost/"), 1, {".lgp", "is not there", "lumigrid publish"});

  // Files are cut short and damaged.
  const std::string bytes = readText(patches);
  programs::writeText(patches, bytes.substr(0, 1'000));
  expectOneLineError(view(nginx.url() + "/tower/"), 1, {".lgp", "publish the scene again"});
  programs::writeText(patches, bytes);
  const std::string records = objectOf(".lgr");
  std::string flipped = readText(records);
  flipped[20] ^= 1;
  programs::writeText(records, flipped);
  expectOneLineError(view(nginx.url() + "/tower/"), 1, {".lgr", "damaged", "publish the scene again"});
}

TEST_F(StaticScene, aLostPackIsMissedAndTheRestIsShown) {
  const support::Nginx nginx(path("site"));
  fs::remove(objectOf(".lgk"));
  const Tour pictures = tour(nginx.url() + "/tower/", "lost");
  EXPECT_EQ(pictures.pictures.size(), static_cast<std::size_t>(kFrames));
}

TEST_F(StaticScene, theHostCheckNamesWhatIsMissing) {
  const support::Nginx nginx(path("site"), "location /whole/ { alias " + path("site/tower") +
                                               "/; max_ranges 0; }\n"
                                               "location /good/ { alias " +
                                               path("site/tower") +
                                               "/; add_header Access-Control-Allow-Origin \"*\"; add_header "
                                               "Cache-Control \"immutable\"; }\n");
  const auto checked = [&](const std::string& folder) {
    return run("lumigrid-view", {nginx.url() + folder, "--check-host"});
  };
  const auto plain = checked("/tower/");
  EXPECT_EQ(plain.status, 0) << plain.err;
  EXPECT_NE(plain.out.find("good: Range"), std::string::npos) << plain.out;
  EXPECT_NE(plain.out.find("Access-Control-Allow-Origin"), std::string::npos);
  const auto whole = checked("/whole/");
  EXPECT_EQ(whole.status, 1);
  EXPECT_NE(whole.out.find("fails: Range: Ignored"), std::string::npos) << whole.out;
  const auto nothing = checked("/nothing/");
  EXPECT_EQ(nothing.status, 1);
  EXPECT_NE(nothing.out.find("404"), std::string::npos);
  const json list = json::parse(run("lumigrid-view", {nginx.url() + "/good/", "--check-host", "--json"}).out);
  ASSERT_TRUE(list.is_array());
  EXPECT_EQ(list[0]["grade"], "good");
  EXPECT_EQ(run("lumigrid-view", {"ws://127.0.0.1:1/", "--check-host"}).status, 2);
}

}  // namespace
