// Feeds any bytes to the readers of S3's XML and of Content-Range. They must return, with results within their bounds.
#include "repository/objects/s3_xml.h"

#include "base/byte_range.h"
#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const std::string text :
       {"<?xml version=\"1.0\"?><ListBucketResult xmlns=\"x\"><Name>b</Name><IsTruncated>true</IsTruncated>"
        "<Contents><Key>a/b &amp; c</Key><Size>3</Size></Contents><Contents><Key>a&#x2F;&#233;</Key></Contents>"
        "<NextContinuationToken>t&quot;0</NextContinuationToken></ListBucketResult>",
        "<ListBucketResult><Contents/><KeyCount>0</KeyCount></ListBucketResult>",
        "<Error><Code>NoSuchKey</Code><Message>no &lt;key&gt;</Message><Region/></Error>", "bytes 2-5/26", "bytes */7"})
    all.emplace_back(text.begin(), text.end());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  const std::string text(bytes.begin(), bytes.end());
  for (const char* name : {"Code", "Message", "UploadId"})
    if (const auto found = repository::xmlText(text, name)) LUMIGRID_CHECK(found->size() <= text.size());
  if (const auto page = repository::parseS3Page(text)) {
    std::size_t total = page->next_token.size();
    for (const std::string& key : page->keys) total += key.size();
    LUMIGRID_CHECK(total <= 2 * text.size());
  }
  if (const auto range = base::parseContentRange(text); range && range->has_bytes) {
    LUMIGRID_CHECK(range->first <= range->last);
    LUMIGRID_CHECK(!range->size || range->last < *range->size);
  }
}

}  // namespace fuzz
