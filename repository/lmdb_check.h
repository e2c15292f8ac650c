#pragma once
// LMDB trusts its file: a wild page number in a damaged one is a crash. So we look at the file ourselves first.
#include <cstdint>
#include <string>

#include "base/error.h"

namespace repository {

/// Before LMDB opens `directory`/data.mdb: are its two meta pages such that LMDB can work with their numbers? A file
/// that is absent or of no bytes is fine: it will be made.
base::Result<void> checkLmdbHeader(const std::string& directory);

/// How far checkLmdbTrees looks. kKeys reads the pages of keys; kValues the first page of each large value too, whose
/// header LMDB trusts when it frees the value: for writers.
enum class CheckDepth { kKeys, kValues };

/// Walks the trees of the moment `txn_id`, whose read transaction the caller holds: every page that is reached lies in
/// the file, is of the kind that its place needs, is reached once and is not free; every node lies in its page and
/// every value in the file. kBusy: a writer has overwritten that moment's meta page; begin a new transaction and try
/// again.
base::Result<void> checkLmdbTrees(const std::string& directory, std::uint64_t txn_id, CheckDepth depth);

}  // namespace repository
