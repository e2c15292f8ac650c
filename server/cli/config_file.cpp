#include "server/cli/config_file.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "base/file.h"

namespace server::cli {
namespace {

using nlohmann::json;

base::Error wrong(const std::string& path, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, path + ": " + problem};
}

base::Error wrongValue(const std::string& path, const std::string& key, const std::string& problem) {
  return wrong(path, "\"" + key + "\": " + problem);
}

/// An object none of whose keys stands there twice, of which the parser would keep the last without a word.
base::Result<json> readObject(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(path));
  std::set<std::string> keys;
  std::string repeated;
  const auto look = [&](int depth, json::parse_event_t event, json& parsed) {
    if (depth == 1 && event == json::parse_event_t::key && !keys.insert(parsed.get<std::string>()).second)
      repeated = parsed.get<std::string>();
    return true;
  };
  try {
    json object = json::parse(bytes.begin(), bytes.end(), look);
    if (!object.is_object()) return wrong(path, "is no JSON object: {\"port\": 8080, ...}");
    if (!repeated.empty()) return wrongValue(path, repeated, "stands there twice");
    return object;
  } catch (const json::exception& error) {
    // "[json.exception.parse_error.101] parse error at line 3, column 5: ..."
    const std::string text = error.what();
    return wrong(path, text.substr(std::min(text.find("] ") + 2, text.size())));
  }
}

enum class ValueKind { kFlag, kText, kNumber };

ValueKind kindOf(const CLI::Option& option) {
  if (option.get_items_expected_max() == 0) return ValueKind::kFlag;
  return option.get_type_name() == "TEXT" ? ValueKind::kText : ValueKind::kNumber;
}

/// The value as the command line would have it. Numbers may be texts, for the sake of units: "30s", "4G".
base::Result<std::string> textOf(const json& value, ValueKind kind) {
  const auto mismatch = [&](const char* wanted) {
    return base::Error{base::ErrorCode::kInvalidInput, "is " + value.dump() + " and must be " + wanted};
  };
  if (kind == ValueKind::kFlag) {
    if (!value.is_boolean()) return mismatch("true or false");
    return std::string(value.get<bool>() ? "true" : "false");
  }
  if (value.is_string()) return value.get<std::string>();
  if (kind == ValueKind::kText) return mismatch("a text");
  if (!value.is_number()) return mismatch("a number, or a text with its unit");
  return value.dump();
}

base::Result<void> applyValue(CLI::Option& option, const std::string& path, const std::string& key, const json& value) {
  const bool takes_many = option.get_items_expected_max() > 1;
  if (value.is_array() && !takes_many) return wrongValue(path, key, "is a list and must be one value");
  const std::vector<json> values = value.is_array() ? value.get<std::vector<json>>() : std::vector<json>{value};
  if (values.empty()) return wrongValue(path, key, "is an empty list");
  std::vector<std::string> texts;
  for (const json& one : values) {
    auto text = textOf(one, kindOf(option));
    if (!text) return wrongValue(path, key, text.error().message);
    texts.push_back(std::move(*text));
  }
  if (option.count() > 0) return {};  // the command line wins
  try {
    for (std::string& text : texts) option.add_result(std::move(text));
    option.run_callback();
  } catch (const CLI::Error& error) {
    return wrongValue(path, key, error.what());
  }
  return {};
}

CLI::Option* findOption(CLI::App& command, const std::string& key) {
  for (CLI::Option* option : command.get_options()) {
    const std::vector<std::string>& names = option->get_lnames();
    if (std::find(names.begin(), names.end(), key) != names.end()) return option;
  }
  return nullptr;
}

}  // namespace

base::Result<void> applyConfigFile(CLI::App& command, const std::string& path, const std::string& own_option,
                                   const std::string& positional_key, const std::string& positional) {
  LUMIGRID_ASSIGN_OR_RETURN(const json object, readObject(path));
  for (const auto& [key, value] : object.items()) {
    const bool is_option = key != own_option && key != "help";
    CLI::Option* option = key == positional_key ? command.get_option(positional)
                          : is_option           ? findOption(command, key)
                                                : nullptr;
    if (option == nullptr)
      return wrongValue(path, key,
                        "is no key of this file; keys are \"" + positional_key +
                            "\" and the options that --help lists, without their dashes");
    LUMIGRID_TRY(applyValue(*option, path, key, value));
  }
  return {};
}

base::Result<std::vector<std::string>> textsInConfigFile(const std::string& path, const std::string& key) {
  LUMIGRID_ASSIGN_OR_RETURN(const json object, readObject(path));
  const auto found = object.find(key);
  if (found == object.end()) return wrongValue(path, key, "is missing");
  const json values = found->is_array() ? *found : json::array({*found});
  std::vector<std::string> texts;
  for (const json& value : values) {
    if (!value.is_string()) return wrongValue(path, key, "must be a text, or a list of texts");
    texts.push_back(value.get<std::string>());
  }
  if (texts.empty()) return wrongValue(path, key, "is an empty list");
  return texts;
}

}  // namespace server::cli
