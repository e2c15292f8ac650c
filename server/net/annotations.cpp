#include "server/net/annotations.h"

#include <system_error>
#include <utility>

#include "base/json/annotations_file.h"
#include "server/net/http_text.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr const char* kEmptyList = "{\"version\": 1, \"annotations\": []}\n";

}  // namespace

Annotations::Annotations(std::string directory, std::string text) : directory_(std::move(directory)) {
  setText(std::move(text));
  stamp_ = currentStamp();
  if (stamp_) readFile();
}

const Annotations::Document& Annotations::current() {
  const std::optional<FileStamp> stamp = currentStamp();
  if (stamp != stamp_) {
    stamp_ = stamp;
    readFile();
  }
  return document_;
}

std::optional<Annotations::FileStamp> Annotations::currentStamp() const {
  if (directory_.empty()) return std::nullopt;
  const std::filesystem::path path = std::filesystem::path(directory_) / base::kAnnotationsFile;
  std::error_code ec;
  FileStamp stamp;
  stamp.time = std::filesystem::last_write_time(path, ec);
  if (ec) return std::nullopt;
  stamp.size = std::filesystem::file_size(path, ec);
  return stamp;
}

void Annotations::readFile() {
  auto read = base::readAnnotations(directory_);
  if (!read) spdlog::warn("no annotations: {}", read.error().message);
  setText(read && *read ? std::move((*read)->text) : std::string());
}

void Annotations::setText(std::string text) {
  document_.text = text.empty() ? kEmptyList : std::move(text);
  document_.etag = entityTag(base::viewOfText(document_.text));
}

}  // namespace server
