#include "repository/objects/s3_signature.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/hash/sha256.h"
#include "repository/objects/http_client.h"

namespace repository {
namespace {

// Removes outer spaces and turns a row of spaces into one.
std::string canonicalValue(const std::string& value) {
  std::string text;
  for (const char c : value)
    if (c != ' ' || (!text.empty() && text.back() != ' ')) text += c;
  if (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

std::string signedHeaders(const S3Request& request) {
  std::string names;
  for (const auto& [name, value] : request.headers) names += (names.empty() ? "" : ";") + name;
  return names;
}

std::string canonicalRequest(const S3Request& request) {
  std::string text = request.method + "\n" + request.path + "\n" + canonicalQuery(request.query) + "\n";
  for (const auto& [name, value] : request.headers) text += name + ":" + canonicalValue(value) + "\n";
  return text + "\n" + signedHeaders(request) + "\n" + request.payload_sha256;
}

std::string hexOfText(std::string_view text) {
  return base::hexOf(base::sha256(base::viewOfText(text)));
}

}  // namespace

std::string canonicalQuery(const std::map<std::string, std::string>& query) {
  // The order is that of the encoded names.
  std::vector<std::pair<std::string, std::string>> encoded;
  for (const auto& [name, value] : query)
    encoded.emplace_back(percentEncoded(name, false), percentEncoded(value, false));
  std::sort(encoded.begin(), encoded.end());
  std::string text;
  for (const auto& [name, value] : encoded) text += (text.empty() ? "" : "&") + name + "=" + value;
  return text;
}

std::string authorization(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                          const std::string& service, const std::string& time) {
  const std::string day = time.substr(0, 8);
  const std::string scope = day + "/" + region + "/" + service + "/aws4_request";
  const std::string to_sign = "AWS4-HMAC-SHA256\n" + time + "\n" + scope + "\n" + hexOfText(canonicalRequest(request));

  base::Sha256Digest key = base::hmacSha256(base::viewOfText("AWS4" + credentials.secret_key), day);
  for (const std::string& part : {region, service, std::string("aws4_request")}) key = base::hmacSha256(key, part);
  return "AWS4-HMAC-SHA256 Credential=" + credentials.access_key + "/" + scope +
         ", SignedHeaders=" + signedHeaders(request) + ", Signature=" + base::hexOf(base::hmacSha256(key, to_sign));
}

}  // namespace repository
