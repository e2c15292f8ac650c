#pragma once
// Locks between processes (flock). The system releases them when the holder dies. They also hold between machines where
// the file system shares its locks.
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace base {

/// Opens the file `path`, made when it is not there, for reading and writing, and locks it, waiting until it is free;
/// the lock goes with the descriptor. Its holder may remove the file: whoever waited for it then locks the new one of
/// that name, so that no two hold what is called `path`. Errors: kIo, kNotFound, kNoSpace when it cannot be made or
/// locked.
Result<FileDescriptor> lockFile(const std::string& path);
/// The same, but kBusy when somebody else still holds it after `patience_seconds`. 0: tries once.
Result<FileDescriptor> tryLockFile(const std::string& path, double patience_seconds = 0.0);

/// Writes who holds the lock into its file, for the message that others give. Failures are ignored: a full disk may not
/// keep the holder from its work.
void writeHolder(const FileDescriptor& lock, const std::string& holder);
/// The first line that writeHolder wrote into the lock file at `path`; "" when there is none.
std::string readHolder(const std::string& path);

}  // namespace base
