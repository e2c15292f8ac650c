#pragma once
// A small folder like the one that the preset web builds.
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <string>

#include "base/check.h"
#include "base/file.h"

namespace server {

/// The folder is removed with the object.
class PageFolder {
 public:
  PageFolder() {
    static std::atomic<int> counter{0};
    const auto name = "lumigrid_page_" + std::to_string(::getpid()) + "_" + std::to_string(counter++);
    path = (std::filesystem::temp_directory_path() / name).string();
    write("index.html", "<!doctype html><title>page</title>");
    write("index.html.br", "page as brotli");
    write("index.html.gz", "page as gzip");
    write("lumigrid-0123abcd.js", "program");
    write("lumigrid-0123abcd.js.gz", "program as gzip");
    write("lumigrid-0123abcd.wasm", std::string("\0asm", 4));
    write("style.css", "body{}");
    write("icons/32.png", "icon");
  }
  ~PageFolder() { std::filesystem::remove_all(path); }
  PageFolder(const PageFolder&) = delete;
  PageFolder& operator=(const PageFolder&) = delete;

  void write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(std::filesystem::path(path + "/" + name).parent_path());
    LUMIGRID_CHECK(bool(base::writeFileAtomically(path + "/" + name,
                                                  {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()})));
  }

  std::string path;
};

}  // namespace server
