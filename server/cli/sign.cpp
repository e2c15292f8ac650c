// lumigrid sign: makes a link that opens one private scene for a time (docs/private-scenes.md).
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/number.h"
#include "server/auth/signing_keys.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

constexpr std::int64_t kMaxSeconds = std::int64_t{3650} * 86400;  // ten years

struct SignArguments {
  std::string key, scene, expires, url;
  bool json = false;
};

/// "90s", "15m", "24h" or "7d" in seconds.
std::optional<std::int64_t> secondsOf(const std::string& text) {
  if (text.empty()) return std::nullopt;
  const std::int64_t unit = text.back() == 's'   ? 1
                            : text.back() == 'm' ? 60
                            : text.back() == 'h' ? 3600
                            : text.back() == 'd' ? 86400
                                                 : 0;
  const auto number = base::parseDecimal(std::string_view(text).substr(0, text.size() - 1));
  if (unit == 0 || !number || *number == 0 || *number > static_cast<std::uint64_t>(kMaxSeconds / unit))
    return std::nullopt;
  return static_cast<std::int64_t>(*number) * unit;
}

base::Error wrong(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "sign: " + problem};
}

int run(const SignArguments& a) {
  const auto seconds = secondsOf(a.expires);
  if (!seconds) return fail(wrong("--expires '" + a.expires + "' is no time like 90s, 15m, 24h or 7d, at most 3650d"));
  if (!a.url.starts_with("https://") && !a.url.starts_with("http://") && !a.url.starts_with("wss://") &&
      !a.url.starts_with("ws://"))
    return fail(wrong("'" + a.url + "' is no address like https://example.org/tower/"));
  const auto keys = SigningKeys::read(a.key);
  if (!keys) return fail(keys.error());
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::int64_t expires = std::chrono::duration_cast<std::chrono::seconds>(now).count() + *seconds;
  const std::string url = signedUrl(a.url, keys->sign(a.scene, expires));
  if (a.json)
    std::printf("%s\n", nlohmann::ordered_json{{"url", url}, {"expires", expires}}.dump().c_str());
  else
    std::printf("%s\n", url.c_str());
  return kDone;
}

}  // namespace

RunCommand addSign(CLI::App& command) {
  auto a = std::make_shared<SignArguments>();
  command.add_option("URL", a->url, "where the scene is served: https://example.org/tower/")
      ->required()
      ->default_str("");
  command
      .add_option("--key", a->key,
                  "file of the keys that the server has by --signing-key; the first one signs. `openssl rand -hex 32` "
                  "makes one")
      ->required()
      ->default_str("");
  command
      .add_option("--scene", a->scene, "the scene's name: the last part of its place as `lumigrid serve` was given it")
      ->required()
      ->default_str("");
  command.add_option("--expires", a->expires, "how long the link opens the scene: 90s, 15m, 24h, 7d")
      ->required()
      ->default_str("");
  command.add_flag("--json", a->json, "print the link, and when it ends in Unix seconds, as JSON");
  return [a] { return run(*a); };
}

}  // namespace server::cli
