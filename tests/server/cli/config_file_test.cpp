#include "server/cli/config_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_directory.h"

namespace server::cli {
namespace {

// A command with one option of each kind that `lumigrid serve` has.
class ConfigFileTest : public testing::Test {
 protected:
  void SetUp() override {
    app_.option_defaults()->always_capture_default();
    command_ = app_.add_subcommand("serve");
    command_->add_option("SCENE", scenes_)->default_str("");
    command_->add_option("--config", path_);
    command_->add_option("--address", address_);
    command_->add_option("--port", port_);
    command_->add_option("--picture", picture_)->check(CLI::Range(0.0, 1000.0));
    command_->add_option("--prefetch", prefetch_)->transform(CLI::AsSizeValue(true));
    command_->add_flag("--no-access", no_access_);
  }
  base::Result<void> apply(const std::string& text, const std::string& command_line = "serve") {
    path_ = directory_ / "serve.json";
    std::ofstream(path_) << text;
    app_.parse(command_line);
    return applyConfigFile(*command_, path_, "config", "scenes", "SCENE");
  }
  void expectError(const std::string& text, const std::vector<std::string>& pieces) {
    const auto applied = apply(text);
    ASSERT_FALSE(applied) << text;
    for (const std::string& piece : pieces)
      EXPECT_NE(applied.error().message.find(piece), std::string::npos) << piece << " in " << applied.error().message;
    EXPECT_NE(applied.error().message.find(path_), std::string::npos);
    EXPECT_EQ(applied.error().message.find('\n'), std::string::npos) << applied.error().message;
  }

  const support::TemporaryDirectory directory_;
  CLI::App app_;
  CLI::App* command_ = nullptr;
  std::vector<std::string> scenes_;
  std::string path_, address_ = "127.0.0.1";
  std::uint16_t port_ = 8080;
  double picture_ = 64.0;
  std::uint64_t prefetch_ = 1;
  bool no_access_ = false;
};

TEST_F(ConfigFileTest, keysAreOptions) {
  ASSERT_TRUE(apply(R"({"scenes": ["a", "b c"], "address": "0.0.0.0", "port": 0, "picture": 1.5, "prefetch": "4M",
                        "no-access": true})"));
  EXPECT_EQ(scenes_, (std::vector<std::string>{"a", "b c"}));
  EXPECT_EQ(address_, "0.0.0.0");
  EXPECT_EQ(port_, 0);
  EXPECT_EQ(picture_, 1.5);
  EXPECT_EQ(prefetch_, 4'000'000U);
  EXPECT_TRUE(no_access_);
}

TEST_F(ConfigFileTest, theCommandLineWins) {
  ASSERT_TRUE(apply(R"({"scenes": ["a", "b"], "port": 1, "no-access": false, "address": "::1"})",
                    "serve c --port 2 --no-access"));
  EXPECT_EQ(scenes_, std::vector<std::string>{"c"});
  EXPECT_EQ(port_, 2);
  EXPECT_TRUE(no_access_);
  EXPECT_EQ(address_, "::1");
}

TEST_F(ConfigFileTest, oneSceneNeedsNoList) {
  ASSERT_TRUE(apply(R"({"scenes": "a"})"));
  EXPECT_EQ(scenes_, std::vector<std::string>{"a"});
}

TEST_F(ConfigFileTest, unknownKeysAreNamed) {
  expectError(R"({"prot": 1})", {"\"prot\"", "--help"});
  expectError(R"({"config": "x"})", {"\"config\""});
  expectError(R"({"help": true})", {"\"help\""});
  expectError(R"({"SCENE": "x"})", {"\"SCENE\""});
  expectError(R"({"--port": 1})", {"\"--port\""});
}

TEST_F(ConfigFileTest, wrongValuesAreNamed) {
  expectError(R"({"port": true})", {"\"port\"", "true", "number"});
  expectError(R"({"port": "many"})", {"\"port\"", "many"});
  expectError(R"({"port": 70000})", {"\"port\"", "70000"});
  expectError(R"({"port": [1]})", {"\"port\"", "list"});
  expectError(R"({"port": null})", {"\"port\"", "null"});
  expectError(R"({"picture": -1})", {"\"picture\"", "-1"});
  expectError(R"({"address": 5})", {"\"address\"", "5", "text"});
  expectError(R"({"no-access": "yes"})", {"\"no-access\"", "true or false"});
  expectError(R"({"scenes": []})", {"\"scenes\"", "empty"});
  expectError(R"({"scenes": [1]})", {"\"scenes\"", "text"});
  expectError(R"({"scenes": {"a": "b"}})", {"\"scenes\"", "text"});
}

TEST_F(ConfigFileTest, whatIsNoObjectIsRefusedWithItsPlace) {
  expectError("[1]", {"object"});
  expectError("{\"port\": 1,\n \"address\" 2}", {"line 2"});
  expectError("", {"line 1"});
  expectError(R"({"port": 1, "port": 2})", {"\"port\"", "twice"});
}

TEST_F(ConfigFileTest, aFileThatIsNotThereIsNamed) {
  app_.parse("serve");
  const auto applied = applyConfigFile(*command_, directory_ / "none", "config", "scenes", "SCENE");
  ASSERT_FALSE(applied);
  EXPECT_NE(applied.error().message.find(directory_ / "none"), std::string::npos);
}

}  // namespace
}  // namespace server::cli
