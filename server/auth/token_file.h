#pragma once
// Bearer tokens (RFC 6750) that open private scenes, read from the file of `lumigrid serve --tokens`
// (docs/private-scenes.md).
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/hash/sha256.h"

namespace server {

/// A token, of which only the hash is kept.
struct Token {
  base::Sha256Digest digest{};
  std::vector<std::string> scenes;      ///< names under which they are served; empty: all scenes
  std::optional<std::int64_t> expires;  ///< Unix seconds, from which on it opens nothing

  bool opens(std::string_view scene) const;
};

/// Whether a text can be a token: 16 to 256 letters, digits, '-', '.', '_' or '~', which stand in addresses, cookies
/// and header fields as they are. Shorter ones could be guessed.
bool isTokenText(std::string_view text);

/// Errors name the file and the entry, never a token: unreadable, no list of tokens, a member that is unknown or wrong.
base::Result<std::vector<Token>> readTokenFile(const std::string& path);

/// The token of this text; null for another text. The time does not tell which tokens there are.
const Token* findToken(const std::vector<Token>& tokens, std::string_view text);

/// Whether every user of the machine may read the file, which then is no secret of ours.
bool isReadableByAll(const std::string& path);

}  // namespace server
