#include "repository/objects/s3_objects.h"

#include <gtest/gtest.h>

#include "base/file.h"
#include "repository/objects/s3_bucket.h"
#include "repository/objects/s3_xml.h"
#include "tests/repository/objects/scripted_server.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

using base::ErrorCode;
using support::TemporaryDirectory;
using test::Answer;
using test::answer;
using test::headerOf;
using test::part;
using test::ScriptedServer;
using namespace std::chrono_literals;

S3Config configFor(const ScriptedServer& server) {
  S3Config config;
  config.credentials = {"KEY", "hidden", ""};
  config.endpoint = server.url("");
  config.http.retries = 1;
  config.http.first_pause = 1ms;
  return config;
}

Answer fault(const std::string& status, const std::string& code, const std::string& more = "") {
  return answer(
      status, "",
      "<?xml version=\"1.0\"?><Error><Code>" + code + "</Code><Message>so &amp; so</Message>" + more + "</Error>");
}

const std::string kEmptyList = "<ListBucketResult><IsTruncated>false</IsTruncated></ListBucketResult>";

bool isListing(const std::string& request) {
  return request.find("list-type=2") != std::string::npos;
}

std::unique_ptr<ObjectSink> mustOpenSink(const ScriptedServer& server, std::uint64_t part_bytes = 1 << 20) {
  S3Config config = configFor(server);
  config.part_bytes = part_bytes;
  auto sink = openS3Sink("s3://bucket/a/scene", config);
  if (sink) return std::move(*sink);
  ADD_FAILURE() << sink.error().message;
  return nullptr;
}

std::string lineOf(const std::string& request) {
  return request.substr(0, request.find("\r\n"));
}

TEST(S3Source, readsASignedRangeBelowItsPrefix) {
  const ScriptedServer server([](const std::string&, int) { return part("abcdef", 2, 4); });
  const auto source = openS3Source("s3://bucket/a/scene/", configFor(server));
  ASSERT_TRUE(source);
  const auto bytes = (*source)->read("packs/x y.lgk", 2, 3);
  ASSERT_TRUE(bytes) << bytes.error().message;
  EXPECT_EQ(std::string(bytes->begin(), bytes->end()), "cde");
  const std::string request = server.requests()[0];
  EXPECT_EQ(lineOf(request), "GET /bucket/a/scene/packs/x%20y.lgk HTTP/1.1");
  EXPECT_EQ(headerOf(request, "Host"), "127.0.0.1:" + std::to_string(server.port()));
  EXPECT_EQ(headerOf(request, "Range"), "bytes=2-4");
  EXPECT_EQ(headerOf(request, "x-amz-date").size(), 16U);
  EXPECT_EQ(headerOf(request, "Authorization").rfind("AWS4-HMAC-SHA256 Credential=KEY/", 0), 0U);
  EXPECT_EQ((*source)->place(), "s3://bucket/a/scene");
}

TEST(S3Source, aPublicBucketNeedsNoCredentials) {
  const ScriptedServer server([](const std::string& request, int) {
    EXPECT_EQ(headerOf(request, "Authorization"), "");
    return request.find("secret") == std::string::npos ? part("abc", 0, 0) : fault("403 Forbidden", "AccessDenied");
  });
  S3Config config = configFor(server);
  config.credentials = {};
  const auto source = openS3Source("s3://bucket", config);
  EXPECT_TRUE((*source)->read("a", 0, 1));
  const auto refused = (*source)->read("secret", 0, 1);
  EXPECT_EQ(refused.error().code, ErrorCode::kIo);
  EXPECT_NE(refused.error().message.find("no credentials were found; set AWS_ACCESS_KEY_ID"), std::string::npos);
  EXPECT_EQ(openS3Sink("s3://bucket", config).error().code, ErrorCode::kInvalidInput);
}

TEST(S3Source, temporaryCredentialsBringTheirToken) {
  const ScriptedServer server([](const std::string&, int) { return part("abc", 0, 0); });
  S3Config config = configFor(server);
  config.credentials.session_token = "token";
  EXPECT_TRUE((*openS3Source("s3://bucket", config))->read("a", 0, 1));
  EXPECT_EQ(headerOf(server.requests()[0], "x-amz-security-token"), "token");
  EXPECT_NE(headerOf(server.requests()[0], "Authorization").find("x-amz-date;x-amz-security-token,"),
            std::string::npos);
}

TEST(S3Source, eachRefusalSaysWhatToDo) {
  struct Case {
    Answer said;
    ErrorCode code;
    const char* piece;
  };
  const std::vector<Case> cases{
      {fault("404 Not Found", "NoSuchBucket"), ErrorCode::kNotFound, "there is no bucket 'bucket'"},
      {fault("404 Not Found", "NoSuchKey"), ErrorCode::kNotFound, "no such object"},
      {fault("403 Forbidden", "AccessDenied"), ErrorCode::kIo, "access key KEY may not do this"},
      {fault("403 Forbidden", "InvalidAccessKeyId"), ErrorCode::kIo, "does not know access key KEY"},
      {fault("403 Forbidden", "SignatureDoesNotMatch"), ErrorCode::kIo, "look at AWS_SECRET_ACCESS_KEY"},
      {fault("403 Forbidden", "RequestTimeTooSkewed", "<ServerTime>2030-01-01</ServerTime>"), ErrorCode::kIo, "clock"},
      {fault("400 Bad Request", "ExpiredToken"), ErrorCode::kIo, "AWS_SESSION_TOKEN"},
      {fault("400 Bad Request", "AuthorizationHeaderMalformed", "<Region>eu-west-1</Region>"), ErrorCode::kIo,
       "set AWS_REGION to eu-west-1"},
      {fault("301 Moved", "PermanentRedirect"), ErrorCode::kIo, "set AWS_REGION to the bucket's"},
      {fault("503 Slow Down", "SlowDown"), ErrorCode::kNetwork, "503 (overloaded)"},
      {fault("400 Bad Request", "Odd"), ErrorCode::kNetwork, "(Odd: so & so)"},
      {answer("403 Forbidden", "", "<html>"), ErrorCode::kIo, "403 (not allowed)"},
  };
  for (const Case& c : cases) {
    // The answer to HEAD has no body, so a GET asks for the reason.
    const ScriptedServer server([&](const std::string& request, int) {
      Answer said = c.said;
      if (request.rfind("HEAD", 0) == 0) said.bytes = said.bytes.substr(0, said.bytes.find("\r\n\r\n") + 4);
      return said;
    });
    const auto source = openS3Source("s3://bucket/scene", configFor(server));
    for (const base::Error& error : {(*source)->read("a.bin", 0, 1).error(), (*source)->size("a.bin").error()}) {
      EXPECT_EQ(error.code, c.code) << error.message;
      EXPECT_NE(error.message.find(c.piece), std::string::npos) << error.message;
      EXPECT_EQ(error.message.rfind("s3://bucket/scene/a.bin: ", 0), 0U) << error.message;
      EXPECT_EQ(error.message.find("hidden"), std::string::npos) << error.message;
    }
  }
}

TEST(S3Source, otherAddressesAreRefused) {
  for (const char* wrong :
       {"s3://", "s3:///x", "s3://ab", "s3://a/../b", "s3://bucket//x", "s3://bu cket/x", "s3://bucket?x"})
    EXPECT_EQ(openS3Source(wrong, {}).error().code, ErrorCode::kInvalidInput) << wrong;
}

TEST(S3Sink, openingFindsOutAboutTheBucket) {
  for (const auto& [status, code, kind] : {std::tuple("404 Not Found", "NoSuchBucket", ErrorCode::kNotFound),
                                           std::tuple("403 Forbidden", "SignatureDoesNotMatch", ErrorCode::kIo)}) {
    const ScriptedServer server([&, s = status, c = code](const std::string&, int) { return fault(s, c); });
    EXPECT_EQ(openS3Sink("s3://bucket/scene", configFor(server)).error().code, kind);
  }
  const ScriptedServer no_listing([](const std::string&, int) { return fault("403 Forbidden", "AccessDenied"); });
  EXPECT_TRUE(openS3Sink("s3://bucket/scene", configFor(no_listing)));
  const ScriptedServer no_store([](const std::string&, int) { return answer("200 OK", "", "<html>hello</html>"); });
  EXPECT_EQ(openS3Sink("s3://bucket/scene", configFor(no_store)).error().code, ErrorCode::kNetwork);
}

TEST(S3Sink, putsAnObjectWithItsType) {
  const ScriptedServer server([](const std::string& request, int) {
    return isListing(request) ? answer("200 OK", "", kEmptyList) : answer("200 OK", "ETag: \"x\"\r\n", "");
  });
  const auto sink = mustOpenSink(server);
  const std::string text = "hello";
  ASSERT_TRUE(sink->put("scene.json", base::Bytes(text.begin(), text.end()), "application/json"));
  const std::string request = server.requests().back();
  EXPECT_EQ(lineOf(request), "PUT /bucket/a/scene/scene.json HTTP/1.1");
  EXPECT_EQ(headerOf(request, "content-type"), "application/json");
  EXPECT_EQ(headerOf(request, "Content-Length"), "5");
  EXPECT_EQ(headerOf(request, "Expect"), "");
  EXPECT_EQ(request.substr(request.size() - 5), "hello");
  ASSERT_TRUE(sink->put("empty", {}, ""));
  EXPECT_EQ(headerOf(server.requests().back(), "Content-Length"), "0");
  EXPECT_FALSE(sink->put("../x", {}, ""));
}

TEST(S3Sink, sizeTellsAbsentFromWrong) {
  const ScriptedServer server([](const std::string& request, int) {
    if (isListing(request)) return answer("200 OK", "", kEmptyList);
    if (request.find("/there") != std::string::npos) return Answer{"HTTP/1.1 200 OK\r\nContent-Length: 77\r\n\r\n"};
    if (request.find("/absent") != std::string::npos)
      return Answer{"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n"};
    return Answer{"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n"};
  });
  const auto sink = mustOpenSink(server);
  EXPECT_EQ(**sink->size("there"), 77U);
  EXPECT_FALSE(sink->size("absent")->has_value());
  EXPECT_EQ(sink->size("other").error().code, ErrorCode::kIo);
}

TEST(S3Sink, largeFilesGoUpInPartsOfOneUpload) {
  const TemporaryDirectory directory;
  const std::string file = directory / "big";
  ASSERT_TRUE(base::writeFileAtomically(file, base::Bytes(25, 'x')));
  const ScriptedServer server([](const std::string& request, int) {
    const std::string line = lineOf(request);
    if (isListing(request)) return answer("200 OK", "", kEmptyList);
    if (line.find("?uploads=") != std::string::npos)
      return answer("200 OK", "",
                    "<InitiateMultipartUploadResult><UploadId>up/1</UploadId></InitiateMultipartUploadResult>");
    if (line.rfind("PUT", 0) == 0)
      return answer("200 OK", "ETag: \"" + line.substr(line.find("partNumber=") + 11, 1) + "\"\r\n", "");
    return answer("200 OK", "", "<CompleteMultipartUploadResult/>");
  });
  const auto sink = mustOpenSink(server, 10);
  ASSERT_TRUE(sink->putFile("big", file, "application/octet-stream"));
  const auto requests = server.requests();
  ASSERT_EQ(requests.size(), 6U);
  EXPECT_EQ(lineOf(requests[2]), "PUT /bucket/a/scene/big?partNumber=1&uploadId=up%2F1 HTTP/1.1");
  EXPECT_EQ(headerOf(requests[4], "Content-Length"), "5");
  EXPECT_NE(requests[5].find("<Part><PartNumber>3</PartNumber><ETag>\"3\"</ETag></Part></CompleteMultipartUpload>"),
            std::string::npos);
}

TEST(S3Sink, anUploadThatFailsAtAnyStepIsAborted) {
  const TemporaryDirectory directory;
  const std::string file = directory / "big";
  ASSERT_TRUE(base::writeFileAtomically(file, base::Bytes(25, 'x')));
  for (const std::string broken : {"partNumber=1", "partNumber=3", "POST /bucket/a/scene/big?uploadId="}) {
    const ScriptedServer server([&](const std::string& request, int) {
      const std::string line = lineOf(request);
      if (isListing(request)) return answer("200 OK", "", kEmptyList);
      if (line.rfind("DELETE", 0) == 0) return Answer{"HTTP/1.1 204 No Content\r\n\r\n"};
      // Completing the upload fails after its status 200, as S3 may do.
      if (line.find(broken) != std::string::npos)
        return fault(broken[0] == 'P' ? "200 OK" : "400 Bad Request", "InternalError");
      if (line.find("?uploads=") != std::string::npos) return answer("200 OK", "", "<R><UploadId>u</UploadId></R>");
      return answer("200 OK", "ETag: \"1\"\r\n", "");
    });
    const auto put = mustOpenSink(server, 10)->putFile("big", file, "");
    ASSERT_FALSE(put) << broken;
    EXPECT_NE(put.error().message.find("InternalError"), std::string::npos) << put.error().message;
    EXPECT_EQ(lineOf(server.requests().back()), "DELETE /bucket/a/scene/big?uploadId=u HTTP/1.1");
  }
}

TEST(S3Sink, anUploadWhoseLastAnswerWasLostIsDone) {
  const TemporaryDirectory directory;
  const std::string file = directory / "big";
  ASSERT_TRUE(base::writeFileAtomically(file, base::Bytes(25, 'x')));
  const ScriptedServer server([&](const std::string& request, int) {
    const std::string line = lineOf(request);
    if (isListing(request)) return answer("200 OK", "", kEmptyList);
    if (line.find("?uploads=") != std::string::npos) return answer("200 OK", "", "<R><UploadId>u</UploadId></R>");
    if (line.rfind("HEAD", 0) == 0) return Answer{"HTTP/1.1 200 OK\r\nContent-Length: 25\r\n\r\n"};
    if (line.rfind("POST", 0) == 0) return fault("404 Not Found", "NoSuchUpload");
    return answer("200 OK", "ETag: \"1\"\r\n", "");
  });
  EXPECT_TRUE(mustOpenSink(server, 10)->putFile("big", file, ""));
}

TEST(S3Sink, listsAllPagesAndOnlyWhatCanBeOurs) {
  const ScriptedServer server([](const std::string& request, int) {
    const std::string line = lineOf(request);
    if (line.find("max-keys=1&") != std::string::npos || line.find("max-keys=1 ") != std::string::npos)
      return answer("200 OK", "", kEmptyList);
    EXPECT_NE(line.find("prefix=a%2Fscene%2Fpacks%2F"), std::string::npos) << line;
    const auto key = [](const std::string& name) { return "<Contents><Key>" + name + "</Key></Contents>"; };
    if (line.find("continuation-token=t%261") == std::string::npos)
      return answer(
          "200 OK", "",
          "<ListBucketResult><IsTruncated>true</IsTruncated><NextContinuationToken>t&amp;1</NextContinuationToken>" +
              key("a/scene/packs/2 &lt;") + key("a/scene/packs/") + key("b/other") + "</ListBucketResult>");
    return answer(
        "200 OK", "",
        "<ListBucketResult><IsTruncated>false</IsTruncated>" + key("a/scene/packs/1") + "</ListBucketResult>");
  });
  const auto names = mustOpenSink(server)->list("packs");
  ASSERT_TRUE(names) << names.error().message;
  EXPECT_EQ(*names, (std::vector<std::string>{"packs/1", "packs/2 <"}));
}

TEST(S3Sink, aListThatNeverEndsIsAnError) {
  const ScriptedServer server([](const std::string&, int) {
    return answer("200 OK", "",
                  "<ListBucketResult><IsTruncated>true</IsTruncated><NextContinuationToken>t</NextContinuationToken>"
                  "</ListBucketResult>");
  });
  EXPECT_EQ(mustOpenSink(server)->list("").error().code, ErrorCode::kNetwork);
}

// The store answers token t1 with t2, and t2 with t1 again.
TEST(S3Sink, aListThatGoesInCirclesIsAnError) {
  const ScriptedServer server([](const std::string& request, int number) {
    EXPECT_LT(number, 10);
    if (number >= 10) return answer("200 OK", "", kEmptyList);
    const std::string next = lineOf(request).find("continuation-token=t1") == std::string::npos ? "t1" : "t2";
    return answer("200 OK", "",
                  "<ListBucketResult><IsTruncated>true</IsTruncated><NextContinuationToken>" + next +
                      "</NextContinuationToken></ListBucketResult>");
  });
  const auto names = mustOpenSink(server)->list("");
  ASSERT_FALSE(names);
  EXPECT_NE(names.error().message.find("does not end"), std::string::npos) << names.error().message;
}

TEST(S3Sink, removingAnAbsentObjectIsNoError) {
  const ScriptedServer server([](const std::string& request, int) {
    if (isListing(request)) return answer("200 OK", "", kEmptyList);
    if (request.find("/there") != std::string::npos) return Answer{"HTTP/1.1 204 No Content\r\n\r\n"};
    if (request.find("/absent") != std::string::npos) return fault("404 Not Found", "NoSuchKey");
    return fault("403 Forbidden", "AccessDenied");
  });
  const auto sink = mustOpenSink(server);
  EXPECT_TRUE(sink->remove("there"));
  EXPECT_TRUE(sink->remove("absent"));
  EXPECT_EQ(sink->remove("locked").error().code, ErrorCode::kIo);
}

// --- Configuration

EnvironmentVariables environmentOf(std::map<std::string, std::string> values) {
  return [values = std::move(values)](const std::string& name) {
    const auto it = values.find(name);
    return it == values.end() ? std::nullopt : std::optional(it->second);
  };
}

void writeText(const std::string& path, const std::string& text) {
  ASSERT_TRUE(base::writeFileAtomically(path, base::Bytes(text.begin(), text.end())));
}

TEST(S3Config, variablesComeBeforeFiles) {
  const TemporaryDirectory home;
  std::filesystem::create_directories(home / ".aws");
  writeText(home / ".aws/credentials",
            "# mine\n[default]\naws_access_key_id = A\naws_secret_access_key=a=/+\n\n[lab]\naws_access_key_id=L\n"
            "aws_secret_access_key=l\naws_session_token = t\n");
  writeText(home / ".aws/config",
            "[default]\nregion = eu-west-1\n[profile lab]\nregion=lab-1\nendpoint_url = https://store.lab/\ns3 =\n  "
            "region = no\n");

  const auto plain = readS3Config(environmentOf({{"HOME", home.path()}}));
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->credentials.access_key, "A");
  EXPECT_EQ(plain->credentials.secret_key, "a=/+");
  EXPECT_EQ(plain->region, "eu-west-1");
  EXPECT_EQ(plain->endpoint, "");

  const auto lab =
      readS3Config(environmentOf({{"HOME", home.path()}, {"AWS_PROFILE", "lab"}, {"AWS_DEFAULT_REGION", "r"}}));
  ASSERT_TRUE(lab);
  EXPECT_EQ(lab->credentials.session_token, "t");
  EXPECT_EQ(lab->region, "r");
  EXPECT_EQ(lab->endpoint, "https://store.lab");

  const auto variables = readS3Config(environmentOf({{"HOME", home.path()},
                                                     {"AWS_ACCESS_KEY_ID", "V"},
                                                     {"AWS_SECRET_ACCESS_KEY", "v"},
                                                     {"AWS_REGION", "one"},
                                                     {"AWS_DEFAULT_REGION", "two"},
                                                     {"AWS_ENDPOINT_URL", "http://all"},
                                                     {"AWS_ENDPOINT_URL_S3", "http://s3"}}));
  ASSERT_TRUE(variables);
  EXPECT_EQ(variables->credentials.access_key, "V");
  EXPECT_EQ(variables->credentials.session_token, "");
  EXPECT_EQ(variables->region, "one");
  EXPECT_EQ(variables->endpoint, "http://s3");
}

TEST(S3Config, halfAPairAndAMissingProfileAreNamed) {
  const TemporaryDirectory home;
  EXPECT_TRUE(readS3Config(environmentOf({{"HOME", home.path()}})));
  EXPECT_TRUE(readS3Config(environmentOf({})));
  for (const std::map<std::string, std::string>& wrong :
       std::vector<std::map<std::string, std::string>>{{{"AWS_ACCESS_KEY_ID", "A"}},
                                                       {{"AWS_PROFILE", "nobody"}, {"HOME", home.path()}},
                                                       {{"AWS_ENDPOINT_URL", "store:9000"}}}) {
    const auto config = readS3Config(environmentOf(wrong));
    ASSERT_FALSE(config);
    EXPECT_EQ(config.error().code, ErrorCode::kInvalidInput);
  }
}

TEST(S3Bucket, amazonHasTheBucketInTheHostsName) {
  S3Config config;
  config.region = "eu-west-1";
  EXPECT_EQ(S3Bucket::open("s3://my-bucket/x", config)->address(), "https://my-bucket.s3.eu-west-1.amazonaws.com");
  EXPECT_EQ(S3Bucket::open("s3://my.bucket/x", config)->address(), "https://s3.eu-west-1.amazonaws.com/my.bucket");
  config.endpoint = "http://127.0.0.1:9000/store";
  EXPECT_EQ(S3Bucket::open("s3://my-bucket", config)->address(), "http://127.0.0.1:9000/store/my-bucket");
}

TEST(S3Xml, readsElementsAndEntities) {
  EXPECT_EQ(xmlText("<Error><Code>No</Code></Error>", "Code"), "No");
  EXPECT_EQ(xmlText("<Codes>x</Codes><Code a=\"1\">y</Code>", "Code"), "y");
  EXPECT_EQ(xmlText("<Code/>", "Code"), "");
  EXPECT_EQ(xmlText("<Code>&lt;&#233;&#x20AC;&#x1F600;&gt;</Code>", "Code"), "<é€😀>");
  for (const char* wrong :
       {"", "<Code", "<Code>", "<Code>x", "<Code>&nope;</Code>", "<Code>&#x110000;</Code>", "<Code>&</Code>"})
    EXPECT_FALSE(xmlText(wrong, "Code")) << wrong;
  EXPECT_FALSE(parseS3Page("<html/>"));
  EXPECT_FALSE(parseS3Page("<ListBucketResult><Contents></Contents></ListBucketResult>"));
  EXPECT_FALSE(parseS3Page("<ListBucketResult><IsTruncated>true</IsTruncated></ListBucketResult>"));
}

}  // namespace
}  // namespace repository
