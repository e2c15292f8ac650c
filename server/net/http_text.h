#pragma once
// Reads values of HTTP header fields and targets (RFC 9110): content codings, entity tags, queries. Knows no sockets.
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"

namespace server {

/// Whether the value of Accept-Encoding ("gzip, deflate;q=0.5, br") asks for or allows `coding`: named, or covered by
/// "*", with a weight above 0. An absent field (empty) allows none; the uncompressed form is always acceptable.
bool acceptsCoding(std::string_view accept_encoding, std::string_view coding);

/// Whether the value of If-None-Match ("\"a\", W/\"b\"" or "*") names `etag`, compared weakly as for GET.
bool namesEntityTag(std::string_view if_none_match, std::string_view etag);

/// Whether the value of Sec-WebSocket-Key is 16 bytes in base64, as a handshake needs (RFC 6455, section 4.2.1).
bool isWebSocketKey(std::string_view key);

/// A strong entity tag with its quotes, made from the bytes' SHA-256.
std::string entityTag(base::ByteView bytes);

/// A whole answer with a text, after which the connection is closed, as bytes: for peers that have no session.
/// `status`: "503 Service Unavailable".
std::string closingAnswer(std::string_view status, std::string_view text);

/// Reads the names and values of a target's query, "/pick?ox=1&oy=2": percent-decoded, '+' is a space. Errors are one
/// line for the visitor: more than 32 values, a name twice, a name without value, '%' without two hexadecimal digits,
/// control characters.
using Query = std::map<std::string, std::string, std::less<>>;
base::Result<Query> parseQuery(std::string_view target);

}  // namespace server
