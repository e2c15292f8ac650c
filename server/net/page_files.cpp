#include "server/net/page_files.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <system_error>
#include <utility>

#include "base/file.h"
#include "repository/objects/objects.h"
#include "server/net/http_text.h"

namespace server {
namespace {

namespace fs = std::filesystem;

// Far more than the page has: they stop a --web that names a wrong folder, such as a home directory.
constexpr std::size_t kMaxFiles = 256;
constexpr std::uint64_t kMaxBytes = std::uint64_t{64} << 20;
constexpr std::size_t kMinHashDigits = 8;  // shorter runs of these letters occur in words
constexpr std::string_view kHexDigits = "0123456789abcdef";

base::Error wrong(const std::string& directory, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput,
          directory + ": " + problem + "; --web must name the folder that the preset web builds"};
}

/// The names of the regular files below the folder. Their number and the sum of their sizes are bounded.
base::Result<std::vector<std::string>> namesIn(const std::string& directory) {
  std::vector<std::string> names;
  std::uint64_t bytes = 0;
  std::error_code ec;
  fs::recursive_directory_iterator entry(directory, ec);
  for (; !ec && entry != fs::recursive_directory_iterator(); entry.increment(ec)) {
    const bool hidden = entry->path().filename().string().starts_with('.');
    if (hidden || entry->is_symlink(ec)) {
      entry.disable_recursion_pending();
      continue;
    }
    if (!entry->is_regular_file(ec)) continue;
    names.push_back(entry->path().lexically_relative(directory).generic_string());
    if (!repository::isObjectName(names.back())) return wrong(directory, "holds a file whose name no URL can have");
    bytes += entry->file_size(ec);
    if (names.size() > kMaxFiles || bytes > kMaxBytes)
      return wrong(directory, "holds more than " + std::to_string(kMaxFiles) + " files or " +
                                  std::to_string(kMaxBytes >> 20) + " MiB");
  }
  if (ec) return base::Error{base::ErrorCode::kIo, directory + ": cannot be read: " + ec.message()};
  return names;
}

base::Result<PageForm> readForm(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, base::readFile(path));
  PageForm form{std::move(bytes), {}};
  form.etag = entityTag(form.bytes);
  return form;
}

/// The name without the ending, or an empty one when it has another ending.
std::string_view without(std::string_view name, std::string_view ending) {
  return name.ends_with(ending) ? name.substr(0, name.size() - ending.size()) : std::string_view();
}

}  // namespace

const char* contentTypeOf(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, const char*>, 14> kTypes{
      {{".html", "text/html; charset=utf-8"},
       {".js", "text/javascript; charset=utf-8"},
       {".mjs", "text/javascript; charset=utf-8"},
       {".css", "text/css; charset=utf-8"},
       {".wasm", "application/wasm"},
       {".json", "application/json"},
       {".webmanifest", "application/manifest+json"},
       {".svg", "image/svg+xml"},
       {".png", "image/png"},
       {".jpg", "image/jpeg"},
       {".ico", "image/x-icon"},
       {".woff2", "font/woff2"},
       {".txt", "text/plain; charset=utf-8"},
       {".map", "application/json"}}};
  for (const auto& [ending, type] : kTypes)
    if (name.ends_with(ending)) return type;
  return "application/octet-stream";
}

bool isHashedName(std::string_view name) {
  const std::size_t dot = name.rfind('.');
  if (dot == std::string_view::npos) return false;
  const std::size_t before = name.find_last_not_of(kHexDigits, dot - 1);
  if (dot == 0 || before == std::string_view::npos) return false;
  return (name[before] == '-' || name[before] == '.') && dot - before - 1 >= kMinHashDigits;
}

base::Result<PageFiles> readPageFiles(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto names, namesIn(directory));
  PageFiles files;
  for (const std::string& name : names) {
    const std::string_view of_gzip = without(name, ".gz");
    const std::string_view of_brotli = without(name, ".br");
    const std::string plain(!of_gzip.empty() ? of_gzip : !of_brotli.empty() ? of_brotli : std::string_view(name));
    LUMIGRID_ASSIGN_OR_RETURN(auto form, readForm(directory + "/" + name));
    PageFile& file = files[plain];
    (!of_gzip.empty() ? file.gzip : !of_brotli.empty() ? file.brotli : file.plain) = std::move(form);
  }
  for (auto& [name, file] : files) {
    if (file.plain.etag.empty()) return wrong(directory, "holds a compressed form of " + name + " but not the file");
    file.type = contentTypeOf(name);
    file.immutable = isHashedName(name);
  }
  if (!files.contains("index.html")) {
    base::Error none = wrong(directory, "holds no index.html");
    none.code = base::ErrorCode::kNotFound;
    return none;
  }
  return files;
}

std::string installedPageFiles() {
  std::error_code ec;
  const fs::path program = fs::read_symlink("/proc/self/exe", ec);
  if (ec) return {};
  const fs::path bin = program.parent_path();
  for (const char* place : {"../share/lumigrid/web", "../../web/site"}) {
    const fs::path folder = (bin / place).lexically_normal();
    if (fs::is_regular_file(folder / "index.html", ec)) return folder.string();
  }
  return {};
}

}  // namespace server
