#pragma once
// Where published scenes lie: named objects that never change once they are there, in a directory, behind a web server
// or in a bucket (DESIGN section 5). Names are relative paths, "images/index.lgi"; no "..", no leading "/".
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace repository {

/// Reading. From any thread.
class ObjectSource {
 public:
  virtual ~ObjectSource() = default;
  /// Bytes offset … offset + length − 1 of the object: exactly so many, or an error that names object and place.
  /// Errors: kNotFound (no such object), kInvalidInput (it is shorter), kIo, kNetwork, kUnsupported (no ranges here).
  virtual base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const = 0;
  /// Bytes of the object. Errors as read.
  virtual base::Result<std::uint64_t> size(const std::string& name) const = 0;
  /// The place, as given: "https://host/scene". For messages.
  virtual const std::string& place() const = 0;
};

/// Writing, for one publisher at a time. From any thread.
class ObjectSink {
 public:
  virtual ~ObjectSink() = default;
  /// Whole and durable on return, or not there.
  virtual base::Result<void> put(const std::string& name, base::ByteView bytes, const std::string& content_type) = 0;
  /// The same from a file, of any size, without taking it into memory.
  virtual base::Result<void> putFile(const std::string& name, const std::string& path,
                                     const std::string& content_type) = 0;
  /// Its bytes, or nothing when there is no such object.
  virtual base::Result<std::optional<std::uint64_t>> size(const std::string& name) = 0;
  /// Names below "prefix" (a folder, or "" for all), ascending.
  virtual base::Result<std::vector<std::string>> list(const std::string& prefix) = 0;
  virtual base::Result<void> remove(const std::string& name) = 0;
  virtual const std::string& place() const = 0;
};

/// `place`: a directory. Errors: kNotFound when it is not there.
base::Result<std::unique_ptr<ObjectSource>> openDirectorySource(const std::string& place);
/// Makes the directory. kBusy while another sink of it is open, in any process.
base::Result<std::unique_ptr<ObjectSink>> openDirectorySink(const std::string& place);

/// Whether the name stays within its place: relative, no empty, "." or ".." part, no backslash or control character.
bool isObjectName(const std::string& name);

}  // namespace repository
