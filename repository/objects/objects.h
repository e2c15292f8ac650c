#pragma once
// A published scene is a set of named objects that never change once they are written. They lie in a directory, behind
// a web server or in a bucket. Names are relative paths such as "images/index.lgi", without ".." or a leading "/".
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace repository {

/// Reads objects. Safe from any thread.
class ObjectSource {
 public:
  virtual ~ObjectSource() = default;
  /// Returns bytes offset … offset + length − 1 of the object, exactly `length` of them, or an error that names object
  /// and place: kNotFound (no such object), kInvalidInput (it is shorter), kIo, kNetwork, kUnsupported (the server has
  /// no ranges).
  virtual base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const = 0;
  /// The object's length in bytes. Errors as read().
  virtual base::Result<std::uint64_t> size(const std::string& name) const = 0;
  /// The place as it was given, for messages: "https://host/scene".
  virtual const std::string& place() const = 0;
};

/// Writes objects for one publisher at a time. Safe from any thread.
class ObjectSink {
 public:
  virtual ~ObjectSink() = default;
  /// The object is whole and durable on return, or it is not there.
  virtual base::Result<void> put(const std::string& name, base::ByteView bytes, const std::string& content_type) = 0;
  /// Writes a file of any size as an object, without reading it into memory at once.
  virtual base::Result<void> putFile(const std::string& name, const std::string& path,
                                     const std::string& content_type) = 0;
  /// The object's length in bytes; nothing when there is no such object.
  virtual base::Result<std::optional<std::uint64_t>> size(const std::string& name) = 0;
  /// The names below the folder `prefix` ("": all), ascending.
  virtual base::Result<std::vector<std::string>> list(const std::string& prefix) = 0;
  virtual base::Result<void> remove(const std::string& name) = 0;
  virtual const std::string& place() const = 0;
};

/// `place` is a directory. Errors: kNotFound when it does not exist.
base::Result<std::unique_ptr<ObjectSource>> openDirectorySource(const std::string& place);
/// Creates the directory. Errors: kBusy while another sink of it is open, in any process.
base::Result<std::unique_ptr<ObjectSink>> openDirectorySink(const std::string& place);

/// Whether a name stays within its place: it is relative, has no empty, "." or ".." part and no backslash or control
/// character.
bool isObjectName(const std::string& name);
/// kInvalidInput for a name that does not.
base::Result<void> checkObjectName(const std::string& place, const std::string& name);

/// The error of a read that reaches beyond the end of an object; `size` is nothing where the server does not state it.
base::Error tooShortError(const std::string& object, std::optional<std::uint64_t> size, std::uint64_t offset,
                          std::uint64_t length);

}  // namespace repository
