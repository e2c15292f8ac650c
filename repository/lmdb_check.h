#pragma once
// LMDB trusts its file, and a wild page number in a damaged one makes it crash. These checks read the file before LMDB
// does.
#include <cstdint>
#include <string>

#include "base/error.h"

namespace repository {

/// Checks the two meta pages of `directory`/data.mdb before LMDB opens it, so that LMDB can work with their numbers. A
/// file that is absent or empty passes, since LMDB creates it.
base::Result<void> checkLmdbHeader(const std::string& directory);

/// kKeys reads the pages of keys. kValues, for writers, also reads the first page of each large value, whose header
/// LMDB trusts when it frees the value.
enum class CheckDepth { kKeys, kValues };

/// Walks the trees of transaction `txn_id`, which the caller holds open for reading. Every page reached must lie in the
/// file, be of the kind that its place needs, be reached once and not be free; every node must lie in its page and
/// every value in the file. Errors: kInvalidInput; kBusy when a writer has overwritten that transaction's meta page,
/// after which the caller begins a new transaction and tries again.
base::Result<void> checkLmdbTrees(const std::string& directory, std::uint64_t txn_id, CheckDepth depth);

}  // namespace repository
