#include "repository/objects/s3_bucket.h"

#include <array>
#include <ctime>
#include <utility>

#include "base/hash/sha256.h"
#include "repository/objects/objects.h"
#include "repository/objects/s3_signature.h"
#include "repository/objects/s3_xml.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

std::string timeNow() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  std::array<char, 20> text{};
  return {text.data(), std::strftime(text.data(), text.size(), "%Y%m%dT%H%M%SZ", &parts)};
}

// Amazon's rules for bucket names are stricter, but older stores hold other names. These characters suffice to keep a
// name from reaching another path or host.
bool isBucketName(const std::string& name) {
  return name.size() >= 3 && name.size() <= 255 && name[0] != '.' && name[0] != '-' &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_") ==
             std::string::npos &&
         name.find("..") == std::string::npos;
}

// Whether the name can be part of a host name that the store's certificate (*.s3…) covers, which a dot prevents.
bool fitsHost(const std::string& bucket) {
  return bucket.size() <= 63 && bucket.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-") == std::string::npos;
}

}  // namespace

Result<S3Bucket> S3Bucket::open(const std::string& place, const S3Config& config) {
  std::string rest = place.substr(5);  // behind "s3://"
  while (!rest.empty() && rest.back() == '/') rest.pop_back();
  const std::string bucket = rest.substr(0, rest.find('/'));
  const std::string prefix = bucket.size() < rest.size() ? rest.substr(bucket.size() + 1) : "";
  if (!isBucketName(bucket) || (!prefix.empty() && !isObjectName(prefix)))
    return Error{ErrorCode::kInvalidInput, place + ": no place in a bucket; write s3://bucket/prefix"};
  return S3Bucket("s3://" + rest, bucket, prefix.empty() ? "" : prefix + "/", config);
}

S3Bucket::S3Bucket(std::string place, std::string bucket, std::string prefix, const S3Config& config)
    : place_(std::move(place)),
      bucket_(std::move(bucket)),
      prefix_(std::move(prefix)),
      config_(config),
      client_(std::make_shared<HttpClient>(config.http)) {
  // Amazon wants the bucket in the host's name. It goes into the path at other stores, and where it fits no host name.
  const bool in_host = config.endpoint.empty() && fitsHost(bucket_);
  address_ = config.endpoint;
  if (address_.empty()) {
    address_ = "https://";
    if (in_host) address_.append(bucket_).append(".");
    address_.append("s3.").append(config.region).append(".amazonaws.com");
  }
  const std::size_t host = address_.find("://") + 3;
  const std::size_t path = std::min(address_.find('/', host), address_.size());
  host_ = address_.substr(host, path - host);
  root_ = address_.substr(path);
  if (!in_host) root_.append("/").append(bucket_);
  address_.resize(path);
}

Result<HttpResponse> S3Bucket::send(const BucketRequest& call) const {
  S3Request signed_request;
  signed_request.method = call.method;
  signed_request.path = root_ + "/" + (call.name.empty() ? "" : percentEncoded(prefix_ + call.name, true));
  signed_request.query = call.query;
  signed_request.payload_sha256 = base::hexOf(base::sha256(call.body));

  HttpRequest request;
  request.method = call.method;
  request.body = call.body;
  request.max_body_bytes = call.max_body_bytes;
  request.url = address_ + signed_request.path;
  if (!call.query.empty()) request.url.append("?").append(canonicalQuery(call.query));
  request.headers = [&] {
    std::vector<std::string> lines{"Host: " + host_};
    for (const auto& [name, value] : call.headers) lines.push_back(name + ": " + value);
    if (call.headers.count("content-type") == 0) lines.emplace_back("Content-Type:");  // not libcurl's own
    if (!isSigned()) return lines;
    std::map<std::string, std::string> headers{
        {"host", host_}, {"x-amz-content-sha256", signed_request.payload_sha256}, {"x-amz-date", timeNow()}};
    if (!config_.credentials.session_token.empty()) headers["x-amz-security-token"] = config_.credentials.session_token;
    signed_request.headers = headers;
    headers.erase("host");
    for (const auto& [name, value] : headers) lines.push_back(name + ": " + value);
    lines.push_back("Authorization: " +
                    authorization(signed_request, config_.credentials, config_.region, "s3", headers["x-amz-date"]));
    return lines;
  };
  auto response = client_->send(request);
  if (!response) return base::within(describe(call.name), response.error());
  return response;
}

Result<HttpResponse> S3Bucket::request(const std::string& method, const std::string& name,
                                       const std::vector<std::string>& headers, std::uint64_t max_body_bytes) const {
  BucketRequest call{method, name, {}, {}, {}, max_body_bytes};
  for (const std::string& line : headers) {
    const auto colon = line.find(": ");
    call.headers[line.substr(0, colon)] = line.substr(colon + 2);
  }
  return send(call);
}

Error S3Bucket::refusal(const std::string& name, const HttpResponse& response) const {
  if (response.body.empty() && response.head.status >= 300 && response.head.status < 500) {
    BucketRequest with_body{"GET", name, {}, {{"range", "bytes=0-0"}}, {}, 1};
    const auto whole = send(with_body);
    if (whole && whole->head.status >= 300) return explain(name, whole->head.status, base::textOf(whole->body));
  }
  return explain(name, response.head.status, base::textOf(response.body));
}

Error S3Bucket::explain(const std::string& name, int status, std::string_view xml) const {
  const std::string code = printable(xmlText(xml, "Code").value_or(""));
  const std::string store = config_.endpoint.empty() ? "Amazon S3" : config_.endpoint;
  const std::string key = "access key " + printable(config_.credentials.access_key);
  const auto say = [&](ErrorCode kind, const std::string& problem) {
    return Error{kind, describe(name) + ": " + (code.empty() ? std::to_string(status) : code) + ": " + problem};
  };
  if (code == "NoSuchBucket")
    return say(ErrorCode::kNotFound, "there is no bucket '" + bucket_ + "' at " + store +
                                         "; make it, or look at its name and at AWS_ENDPOINT_URL");
  if (code == "NoSuchKey")
    return say(ErrorCode::kNotFound, "no such object; look at the prefix, or publish the scene again");
  if (!isSigned() && status >= 400 && status < 500 && status != 404)
    return say(ErrorCode::kIo,
               "the bucket is not public and no credentials were found; set AWS_ACCESS_KEY_ID and "
               "AWS_SECRET_ACCESS_KEY, or AWS_PROFILE");
  if (code == "AccessDenied")
    return say(ErrorCode::kIo, key + " may not do this here; grant it access to the bucket, or give other credentials");
  if (code == "InvalidAccessKeyId")
    return say(ErrorCode::kIo, store + " does not know " + key + "; look at AWS_ACCESS_KEY_ID and AWS_ENDPOINT_URL");
  if (code == "SignatureDoesNotMatch")  // some stores say so too when they do not know the key
    return say(ErrorCode::kIo,
               "the secret key is not that of " + key + "; look at AWS_SECRET_ACCESS_KEY and AWS_ACCESS_KEY_ID");
  if (code == "RequestTimeTooSkewed")
    return say(ErrorCode::kIo, "this machine's clock (" + timeNow() + ") is not the store's (" +
                                   printable(xmlText(xml, "ServerTime").value_or("unknown")) + "); set it right");
  if (code == "ExpiredToken" || code == "InvalidToken" || code == "TokenRefreshRequired")
    return say(ErrorCode::kIo, "the temporary credentials are no longer valid; get new ones (AWS_SESSION_TOKEN)");
  if (code == "PermanentRedirect" || code == "AuthorizationHeaderMalformed" ||
      code == "IllegalLocationConstraintException")
    return say(ErrorCode::kIo, "the bucket is not in region " + printable(config_.region) + "; set AWS_REGION to " +
                                   printable(xmlText(xml, "Region").value_or("the bucket's")));
  Error plain = statusError(describe(name), status);
  if (!code.empty()) plain.message += " (" + code + ": " + printable(xmlText(xml, "Message").value_or("")) + ")";
  return plain;
}

}  // namespace repository
