// Tests several scenes on one port.
#include "server/net/scene_names.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

TEST(SceneNames, namesAreTheLastPartsOfThePlaces) {
  const auto names = sceneNames({"/data/tower", "/data/old town/", "https://host/scenes/harbour", "s3://bucket/mill"});
  ASSERT_TRUE(names) << names.error().message;
  EXPECT_EQ(*names, (std::vector<std::string>{"tower", "old-town", "harbour", "mill"}));
  for (const std::vector<std::string>& bad :
       {std::vector<std::string>{"/a/tower", "/b/tower"}, {"/a/tower", "/a/./tower/"}, {"/"}, {"https://host/.."}}) {
    const auto none = sceneNames(bad);
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().message.find('\n'), std::string::npos);
  }
}

TEST(SceneNames, targetsAreSplitAtTheirFirstFolder) {
  const auto split = [](std::string_view target) {
    const NamedTarget named = splitTarget(target);
    return std::string(named.name) + "|" + std::string(named.rest);
  };
  EXPECT_EQ(split("/tower/scene.json?x=/y"), "tower|/scene.json?x=/y");
  EXPECT_EQ(split("/tower/"), "tower|/");
  EXPECT_EQ(split("/tower"), "tower|");
  EXPECT_EQ(split("/tower?x=1/2"), "tower|");
  EXPECT_EQ(split("/"), "|");
  EXPECT_EQ(split(""), "|");
  EXPECT_EQ(split("*"), "|");
}

TEST(SceneNames, listGroupsTheDigitsOfCounts) {
  const std::string list = sceneListPage({{"tower", 3'024'763}, {"mill", 999}, {"mast", 1'000}}, "ws://host:8080");
  for (const char* piece : {">3,024,763 triangles", ">999 triangles", ">1,000 triangles", "ws://host:8080/mill/"})
    EXPECT_NE(list.find(piece), std::string::npos) << list;
}

TEST(SeveralScenes, eachIsBelowItsNameAndTheRootListsThem) {
  const SceneDirectory tower, mill;
  RunningServer server({tower.path, mill.path});
  const std::vector<std::string> names = server.server->names();
  ASSERT_EQ(names.size(), 2U);
  const std::uint16_t port = server.port();

  const HttpAnswer list = httpRequest(port, "/");
  EXPECT_EQ(list.status, 200);
  for (const std::string& name : names) EXPECT_NE(list.body.find("href=\"" + name + "/\""), std::string::npos);
  EXPECT_EQ(httpRequest(port, "/healthz").status, 200);
  EXPECT_EQ(httpRequest(port, "/scene.json").status, 404);
  EXPECT_EQ(httpRequest(port, "/nobody/scene.json").status, 404);
  EXPECT_EQ(httpRequest(port, "/", {}, "POST").status, 405);

  for (const std::string& name : names) {
    EXPECT_EQ(httpRequest(port, "/" + name + "/scene.json").status, 200);
    EXPECT_EQ(httpRequest(port, "/" + name + "/").status, 200);
    const HttpAnswer moved = httpRequest(port, "/" + name);
    EXPECT_EQ(moved.status, 301);
    EXPECT_EQ(moved.headers.at("location"), "/" + name + "/");
    const HttpAnswer picked = httpRequest(port, "/" + name + "/pick?ox=500016.3&oy=4000016.2&oz=600&dx=0&dy=0&dz=-1");
    EXPECT_EQ(picked.status, 200);
    EXPECT_NE(picked.body.find("\"hit\":true"), std::string::npos) << picked.body;
    EXPECT_EQ(httpRequest(port, "/" + name + "/nothing").status, 404);

    // A viewer is welcomed to that scene.
    const auto viewer = LoopbackClient::connect(port, "/" + name + "/");
    ASSERT_NE(viewer, nullptr);
    ASSERT_TRUE(viewer->send(protocol::Hello{protocol::kVersion, "test"}));
    const auto message = viewer->receive();
    ASSERT_TRUE(message);
    const auto* welcome = std::get_if<protocol::Welcome>(&*message);
    ASSERT_NE(welcome, nullptr);
    EXPECT_EQ(welcome->scene_name, name);
  }
}

TEST(SeveralScenes, conflictingOptionsAreRefused) {
  const SceneDirectory scene, other;
  EXPECT_FALSE(Server::open({}, RunningServer::quiet()));
  EXPECT_FALSE(Server::open({scene.path, scene.path}, RunningServer::quiet()));
  ServerOptions counted = RunningServer::quiet();
  counted.port = 0;
  counted.access_file = scene.path + "/all.lga";
  const auto refused = Server::open({scene.path, other.path}, counted);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("--access-file"), std::string::npos);
}

}  // namespace
}  // namespace server
