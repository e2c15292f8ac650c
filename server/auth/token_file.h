#pragma once
// Bearer tokens (RFC 6750) that open private scenes, read from the file of `lumigrid serve --tokens`
// (docs/private-scenes.md).
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
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

/// The tokens of a file, in its order.
class TokenList {
 public:
  /// The last one that was added counts where several have the same digest.
  void add(Token token);
  /// The token of this text; null for another text. Takes the same time however many tokens there are. They are looked
  /// up by their digests without regard to what the time tells: whoever learns a piece of a digest knows no more of a
  /// secret with that digest, and cannot make texts whose digests come ever closer to it other than by guessing.
  const Token* find(std::string_view text) const;
  const std::vector<Token>& all() const { return tokens_; }

 private:
  struct FirstBytes {  // the bytes of a digest are spread evenly, so that some of them are a hash
    std::size_t operator()(const base::Sha256Digest& digest) const {
      std::size_t value = 0;
      std::memcpy(&value, digest.data(), sizeof value);
      return value;
    }
  };
  std::vector<Token> tokens_;
  std::unordered_map<base::Sha256Digest, std::size_t, FirstBytes> places_;  // in tokens_
};

/// Whether a text can be a token: 16 to 256 letters, digits, '-', '.', '_' or '~', which stand in addresses, cookies
/// and header fields as they are. Shorter ones could be guessed.
bool isTokenText(std::string_view text);

/// Errors name the file and the entry, never a token: unreadable, no list of tokens, a member that is unknown or wrong.
base::Result<TokenList> readTokenFile(const std::string& path);

/// Whether every user of the machine may read the file, which then is no secret of ours.
bool isReadableByAll(const std::string& path);

}  // namespace server
