#include "server/auth/token_file.h"

#include <sys/stat.h>

#include <algorithm>
#include <ctime>
#include <utility>

#include "base/file.h"
#include "base/json/parse.h"

namespace server {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMinTokenLength = 16;  // characters; 62^16 of letters and digits are 95 bits
constexpr std::size_t kMaxTokenLength = 256;
constexpr std::size_t kMaxTokens = 100'000;

/// "2027-01-31T12:00:00Z" or "2027-01-31" (its begin, UTC) as Unix seconds.
std::optional<std::int64_t> parseUtcTime(const std::string& text) {
  for (const char* format : {"%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%d"}) {
    std::tm parts{};
    const char* end = ::strptime(text.c_str(), format, &parts);
    if (end != nullptr && *end == '\0') return ::timegm(&parts);
  }
  return std::nullopt;
}

base::Error wrong(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem};
}

base::Result<base::Sha256Digest> digestOf(const Json& entry) {
  if (entry.contains("token") == entry.contains("sha256"))
    return wrong("needs either 'token' or 'sha256', the token's hash");
  if (entry.contains("token")) {
    const Json& token = entry["token"];
    if (!token.is_string() || !isTokenText(token.get_ref<const std::string&>()))
      return wrong("'token' is not 16 to 256 letters, digits, '-', '.', '_' or '~'; `openssl rand -hex 32` makes one");
    return base::sha256(base::viewOfText(token.get_ref<const std::string&>()));
  }
  const Json& text = entry["sha256"];
  const auto bytes = text.is_string() ? base::bytesOfHex(text.get_ref<const std::string&>()) : std::nullopt;
  base::Sha256Digest digest{};
  if (!bytes || bytes->size() != digest.size())
    return wrong("'sha256' is not 64 lower-case hexadecimal digits; `printf %s TOKEN | sha256sum` prints them");
  std::copy(bytes->begin(), bytes->end(), digest.begin());
  return digest;
}

base::Result<std::vector<std::string>> scenesOf(const Json& entry) {
  const auto problem = wrong("'scenes' must be \"all\" or a list of scenes' names");
  if (!entry.contains("scenes")) return problem;
  const Json& scenes = entry["scenes"];
  if (scenes == "all") return std::vector<std::string>();
  if (!scenes.is_array() || scenes.empty()) return problem;
  std::vector<std::string> names;
  for (const Json& name : scenes) {
    if (!name.is_string() || name.get_ref<const std::string&>().empty()) return problem;
    names.push_back(name.get<std::string>());
  }
  return names;
}

base::Result<std::optional<std::int64_t>> expiryOf(const Json& entry) {
  if (!entry.contains("expires")) return std::optional<std::int64_t>();
  const Json& expires = entry["expires"];
  if (expires.is_number_integer()) return std::optional(expires.get<std::int64_t>());
  const auto time = expires.is_string() ? parseUtcTime(expires.get<std::string>()) : std::nullopt;
  if (!time) return wrong("'expires' is neither Unix seconds nor a time like \"2027-01-31T12:00:00Z\"");
  return time;
}

base::Result<Token> tokenOf(const Json& entry) {
  if (!entry.is_object()) return wrong("is no object");
  for (const auto& [name, value] : entry.items())
    if (name != "token" && name != "sha256" && name != "scenes" && name != "expires" && name != "note")
      return wrong("has an unknown member; there are token, sha256, scenes, expires, note");
  Token token;
  LUMIGRID_ASSIGN_OR_RETURN(token.digest, digestOf(entry));
  LUMIGRID_ASSIGN_OR_RETURN(token.scenes, scenesOf(entry));
  LUMIGRID_ASSIGN_OR_RETURN(token.expires, expiryOf(entry));
  return token;
}

}  // namespace

bool Token::opens(std::string_view scene) const {
  return scenes.empty() || std::find(scenes.begin(), scenes.end(), scene) != scenes.end();
}

void TokenList::add(Token token) {
  places_.insert_or_assign(token.digest, tokens_.size());
  tokens_.push_back(std::move(token));
}

const Token* TokenList::find(std::string_view text) const {
  if (tokens_.empty() || !isTokenText(text)) return nullptr;
  const auto place = places_.find(base::sha256(base::viewOfText(text)));
  return place == places_.end() ? nullptr : &tokens_[place->second];
}

bool isTokenText(std::string_view text) {
  return text.size() >= kMinTokenLength && text.size() <= kMaxTokenLength &&
         text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._~") ==
             std::string_view::npos;
}

base::Result<TokenList> readTokenFile(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const base::Bytes bytes, base::readFile(path));
  const Json list = base::parseJson(bytes);
  if (!list.is_array())
    return base::within(path, wrong("is no list of tokens like [{\"token\": \"…\", \"scenes\": [\"tower\"]}]"));
  if (list.size() > kMaxTokens)
    return base::within(path, wrong("has more than " + std::to_string(kMaxTokens) + " tokens"));
  TokenList tokens;
  for (const Json& entry : list) {
    auto token = tokenOf(entry);
    if (!token) return base::within(path + ": token " + std::to_string(tokens.all().size() + 1), token.error());
    tokens.add(std::move(*token));
  }
  return tokens;
}

bool isReadableByAll(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 && (status.st_mode & S_IROTH) != 0;
}

}  // namespace server
