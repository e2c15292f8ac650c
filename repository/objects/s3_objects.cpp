#include "repository/objects/s3_objects.h"

#include <algorithm>
#include <set>
#include <utility>

#include "base/file.h"
#include "base/number.h"
#include "repository/objects/s3_bucket.h"
#include "repository/objects/s3_xml.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

constexpr std::uint64_t kMaxAnswerBytes = std::uint64_t{8} << 20;  // a page of 1000 keys of 1000 bytes, and more
constexpr std::uint64_t kMaxParts = 10000;                         // S3's limit

class S3Sink final : public ObjectSink {
 public:
  explicit S3Sink(S3Bucket bucket) : bucket_(std::move(bucket)) {}

  Result<void> put(const std::string& name, base::ByteView bytes, const std::string& content_type) override {
    LUMIGRID_TRY(checkObjectName(place(), name));
    BucketRequest call{"PUT", name, {}, {}, bytes, kMaxAnswerBytes};
    if (!content_type.empty()) call.headers["content-type"] = content_type;
    if (const auto answer = sendChecked(call); !answer) return answer.error();
    return {};
  }

  Result<void> putFile(const std::string& name, const std::string& path, const std::string& content_type) override {
    LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(path));
    if (file.bytes().size() <= bucket_.config().part_bytes) return put(name, file.bytes(), content_type);
    LUMIGRID_TRY(checkObjectName(place(), name));
    return putParts(name, file.bytes(), content_type);
  }

  Result<std::optional<std::uint64_t>> size(const std::string& name) override {
    LUMIGRID_TRY(checkObjectName(place(), name));
    LUMIGRID_ASSIGN_OR_RETURN(const auto response, bucket_.send({"HEAD", name, {}, {}, {}, 0}));
    if (response.head.status == 404) return std::optional<std::uint64_t>();  // openS3Sink has found the bucket itself
    if (response.head.status != 200) return bucket_.refusal(name, response);
    const auto bytes = base::parseDecimal(response.head.header("content-length"));
    if (!bytes) return Error{ErrorCode::kNetwork, bucket_.describe(name) + ": the store does not say how long it is"};
    return std::optional(*bytes);
  }

  Result<std::vector<std::string>> list(const std::string& prefix) override {
    if (!prefix.empty()) LUMIGRID_TRY(checkObjectName(place(), prefix));
    const std::string front = bucket_.prefix() + (prefix.empty() ? "" : prefix + "/");
    std::vector<std::string> names;
    std::set<std::string> asked;
    for (std::string token;;) {
      LUMIGRID_ASSIGN_OR_RETURN(auto page, listPage(front, token, 1000));
      for (const std::string& key : page.keys) {
        // Other programs may keep objects in the bucket.
        if (key.rfind(front, 0) != 0) continue;
        std::string name = key.substr(bucket_.prefix().size());
        if (isObjectName(name)) names.push_back(std::move(name));
      }
      if (page.next_token.empty()) break;
      if (!asked.insert(page.next_token).second)
        return Error{ErrorCode::kNetwork, bucket_.describe(prefix) + ": the store's list of objects does not end"};
      token = page.next_token;
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  Result<void> remove(const std::string& name) override {
    LUMIGRID_TRY(checkObjectName(place(), name));
    LUMIGRID_ASSIGN_OR_RETURN(const auto response, bucket_.send({"DELETE", name, {}, {}, {}, kMaxAnswerBytes}));
    if (response.head.status >= 300 && response.head.status != 404) return bucket_.refusal(name, response);
    return {};
  }

  const std::string& place() const override { return bucket_.place(); }

  Result<S3Page> listPage(const std::string& prefix, const std::string& token, int most_keys) const {
    BucketRequest call{"GET", "", {{"list-type", "2"}, {"max-keys", std::to_string(most_keys)}},
                       {},    {}, kMaxAnswerBytes};
    if (!prefix.empty()) call.query["prefix"] = prefix;
    if (!token.empty()) call.query["continuation-token"] = token;
    LUMIGRID_ASSIGN_OR_RETURN(const auto response, sendChecked(call));
    auto page = parseS3Page(base::textOf(response.body));
    if (!page) return base::within(bucket_.place(), page.error());
    return page;
  }

 private:
  // Sends a request and returns its answer only if it succeeded. S3 may fail after it has sent "200 OK"; the body is an
  // <Error> then.
  Result<HttpResponse> sendChecked(const BucketRequest& call) const {
    LUMIGRID_ASSIGN_OR_RETURN(auto response, bucket_.send(call));
    const bool failed_late = xmlText(base::textOf(response.body), "Code").has_value();
    if (response.head.status < 200 || response.head.status >= 300 || failed_late)
      return bucket_.refusal(call.name, response);
    return response;
  }

  // Uploads all parts under one upload id; the object appears when the upload is completed. A failed upload is aborted,
  // because stores keep and charge for the parts of unfinished ones.
  Result<void> putParts(const std::string& name, base::ByteView bytes, const std::string& content_type) {
    BucketRequest begin{"POST", name, {{"uploads", ""}}, {}, {}, kMaxAnswerBytes};
    if (!content_type.empty()) begin.headers["content-type"] = content_type;
    LUMIGRID_ASSIGN_OR_RETURN(const auto begun, sendChecked(begin));
    const auto upload = xmlText(base::textOf(begun.body), "UploadId");
    if (!upload || upload->empty())
      return Error{ErrorCode::kNetwork, bucket_.describe(name) + ": the store begins no upload; is this an S3 store?"};

    const auto done = sendParts(name, bytes, *upload);
    if (done) return {};
    const auto aborted = bucket_.send({"DELETE", name, {{"uploadId", *upload}}, {}, {}, kMaxAnswerBytes});
    Error error = done.error();
    if (!aborted || (aborted->head.status >= 300 && aborted->head.status != 404))
      error.message += "; an unfinished upload is left in the bucket, abort upload " + printable(*upload);
    return error;
  }

  Result<void> sendParts(const std::string& name, base::ByteView bytes, const std::string& upload) {
    const std::uint64_t part_bytes = std::max(bucket_.config().part_bytes, (bytes.size() + kMaxParts - 1) / kMaxParts);
    std::string list;
    for (std::uint64_t offset = 0, number = 1; offset < bytes.size(); offset += part_bytes, ++number) {
      const auto body = bytes.subspan(offset, std::min<std::uint64_t>(part_bytes, bytes.size() - offset));
      LUMIGRID_ASSIGN_OR_RETURN(const auto sent,
                                sendChecked({"PUT",
                                             name,
                                             {{"partNumber", std::to_string(number)}, {"uploadId", upload}},
                                             {},
                                             body,
                                             kMaxAnswerBytes}));
      const std::string tag = sent.head.header("etag");
      if (tag.empty() || tag.find_first_of("<&") != std::string::npos)
        return Error{ErrorCode::kNetwork, bucket_.describe(name) + ": the store gives no tag for a part"};
      list += "<Part><PartNumber>" + std::to_string(number) + "</PartNumber><ETag>" + tag + "</ETag></Part>";
    }
    return complete(name, upload, "<CompleteMultipartUpload>" + list + "</CompleteMultipartUpload>", bytes.size());
  }

  Result<void> complete(const std::string& name, const std::string& upload, const std::string& xml,
                        std::uint64_t bytes) {
    const base::Bytes body(xml.begin(), xml.end());
    const auto answered = sendChecked(
        {"POST", name, {{"uploadId", upload}}, {{"content-type", "application/xml"}}, body, kMaxAnswerBytes});
    if (answered) return {};
    // An earlier attempt may have completed the upload and only its answer was lost. Then the upload is gone and the
    // object is there.
    if (answered.error().message.find("NoSuchUpload") != std::string::npos)
      if (const auto there = size(name); there && *there == bytes) return {};
    return answered.error();
  }

  S3Bucket bucket_;
};

}  // namespace

Result<std::unique_ptr<ObjectSource>> openS3Source(const std::string& place, const S3Config& config) {
  LUMIGRID_ASSIGN_OR_RETURN(auto bucket, S3Bucket::open(place, config));
  const std::string clean = bucket.place();
  return makeWebSource(clean, std::make_unique<S3Bucket>(std::move(bucket)));
}

Result<std::unique_ptr<ObjectSink>> openS3Sink(const std::string& place, const S3Config& config) {
  LUMIGRID_ASSIGN_OR_RETURN(auto bucket, S3Bucket::open(place, config));
  if (!bucket.isSigned())
    return Error{
        ErrorCode::kInvalidInput,
        place + ": no credentials to write with; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"};
  const std::string bucket_prefix = bucket.prefix();
  auto sink = std::make_unique<S3Sink>(std::move(bucket));
  const auto page = sink->listPage(bucket_prefix, "", 1);
  // Credentials that may write need not be allowed to list.
  if (!page && page.error().message.find(": AccessDenied: ") == std::string::npos) return page.error();
  return std::unique_ptr<ObjectSink>(std::move(sink));
}

}  // namespace repository
