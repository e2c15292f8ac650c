#pragma once
// Options of a command from a JSON file in place of the command line (docs/formats/config.md).
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "base/error.h"

namespace server::cli {

/// Gives options that the parsed command line does not name the values of a JSON object whose keys are the options'
/// long names without dashes: {"port": 8080, "scenes": ["tower", "yard"], "no-access": true}. `positional_key`: the
/// key of the command's positional arguments, and `positional` their name in the help. `own_option`: the long name of
/// the option that names the file, which a file cannot have. Errors name file and key: a file that cannot be read, a
/// text that is no object, an unknown or repeated key, a value of the wrong type or out of range.
base::Result<void> applyConfigFile(CLI::App& command, const std::string& path, const std::string& own_option,
                                   const std::string& positional_key, const std::string& positional);

/// The texts of one key of such a file, a list or a single one. Errors as applyConfigFile(); a file without the key.
base::Result<std::vector<std::string>> textsInConfigFile(const std::string& path, const std::string& key);

}  // namespace server::cli
