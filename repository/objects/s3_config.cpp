#include "repository/objects/s3_config.h"

#include <cstdlib>
#include <map>
#include <sstream>
#include <utility>

#include "base/file.h"
#include "base/text.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using base::trimmed;
using Section = std::map<std::string, std::string>;

// Reads lines "[section]", "key = value" and "# comment". Indented lines, which nest below a line such as "s3 =", are
// skipped.
std::map<std::string, Section> parseSections(const std::string& text) {
  std::map<std::string, Section> sections;
  Section* current = nullptr;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    const bool indented = !line.empty() && (line[0] == ' ' || line[0] == '\t');
    line = trimmed(line);
    if (line.empty() || line[0] == '#' || line[0] == ';') continue;
    if (line[0] == '[') {
      current = &sections[trimmed(line.substr(1, line.find(']') - 1))];
      continue;
    }
    const auto equals = line.find('=');
    if (current != nullptr && !indented && equals != std::string::npos)
      (*current)[trimmed(line.substr(0, equals))] = trimmed(line.substr(equals + 1));
  }
  return sections;
}

// Reads the file named by `variable`, or else ~/.aws/`name`. A missing file has no sections.
Result<std::map<std::string, Section>> readSections(const EnvironmentVariables& environment,
                                                    const std::string& variable, const std::string& name) {
  std::string path = environment(variable).value_or("");
  if (path.empty()) {
    const auto home = environment("HOME");
    if (!home) return std::map<std::string, Section>();
    path = *home + "/.aws/" + name;
  }
  const auto bytes = base::readFile(path);
  if (!bytes && bytes.error().code == ErrorCode::kNotFound) return std::map<std::string, Section>();
  if (!bytes) return bytes.error();
  return parseSections({bytes->begin(), bytes->end()});
}

// The profile's settings in both files; those in `credentials` win.
Result<Section> readProfile(const EnvironmentVariables& environment) {
  const auto asked = environment("AWS_PROFILE");
  const std::string name = asked.value_or("default");
  LUMIGRID_ASSIGN_OR_RETURN(auto credentials, readSections(environment, "AWS_SHARED_CREDENTIALS_FILE", "credentials"));
  LUMIGRID_ASSIGN_OR_RETURN(auto config, readSections(environment, "AWS_CONFIG_FILE", "config"));

  const std::string config_name = name == "default" ? name : "profile " + name;
  if (asked && credentials.count(name) == 0 && config.count(config_name) == 0)
    return Error{ErrorCode::kInvalidInput,
                 "AWS_PROFILE: there is no profile '" + name + "' in ~/.aws/credentials or ~/.aws/config"};
  Section profile = credentials[name];
  profile.merge(config[config_name]);
  return profile;
}

Result<S3Credentials> checkedCredentials(const std::string& where, const S3Credentials& read) {
  if (read.access_key.empty() == read.secret_key.empty()) return read;
  return Error{ErrorCode::kInvalidInput,
               where + ": an access key and its secret key belong together, and only one is there; give both"};
}

Result<void> checkEndpoint(const std::string& endpoint) {
  const auto scheme = endpoint.find("://");
  const bool web = endpoint.rfind("http://", 0) == 0 || endpoint.rfind("https://", 0) == 0;
  if (web && endpoint.size() > scheme + 3 && endpoint.find_first_of("?#@ ") == std::string::npos) return {};
  return Error{ErrorCode::kInvalidInput,
               "AWS_ENDPOINT_URL: no address of a store: write http://host:port or https://host"};
}

}  // namespace

Result<S3Config> readS3Config(const EnvironmentVariables& environment) {
  LUMIGRID_ASSIGN_OR_RETURN(auto profile, readProfile(environment));
  const auto first = [&](std::initializer_list<const char*> variables, const char* key) {
    for (const char* variable : variables)
      if (auto value = environment(variable)) return *value;
    return profile[key];
  };

  S3Config config;
  const bool from_variables = environment("AWS_ACCESS_KEY_ID") || environment("AWS_SECRET_ACCESS_KEY");
  const auto credentials =
      from_variables
          ? checkedCredentials("AWS_ACCESS_KEY_ID", {environment("AWS_ACCESS_KEY_ID").value_or(""),
                                                     environment("AWS_SECRET_ACCESS_KEY").value_or(""),
                                                     environment("AWS_SESSION_TOKEN").value_or("")})
          : checkedCredentials("~/.aws/credentials", {profile["aws_access_key_id"], profile["aws_secret_access_key"],
                                                      profile["aws_session_token"]});
  if (!credentials) return credentials.error();
  config.credentials = *credentials;
  if (const std::string region = first({"AWS_REGION", "AWS_DEFAULT_REGION"}, "region"); !region.empty())
    config.region = region;

  config.endpoint = first({"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"}, "endpoint_url");
  if (!config.endpoint.empty()) LUMIGRID_TRY(checkEndpoint(config.endpoint));
  while (!config.endpoint.empty() && config.endpoint.back() == '/') config.endpoint.pop_back();
  config.http.ca_file = first({"AWS_CA_BUNDLE", "SSL_CERT_FILE"}, "ca_bundle");
  return config;
}

Result<S3Config> readS3Config() {
  return readS3Config([](const std::string& name) {
    const char* const value = std::getenv(name.c_str());
    return value == nullptr || *value == '\0' ? std::nullopt : std::optional<std::string>(value);
  });
}

}  // namespace repository
