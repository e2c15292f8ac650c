#pragma once
// Writes the browser client beside a published scene, so that the place opens in a browser with no server of ours.
#include <cstdint>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"
#include "server/net/page_files.h"

namespace server::cli {

/// The object that lists the page's files at the place, each with its SHA-256: other files are somebody else's, and are
/// not replaced.
inline constexpr const char* kPageList = "lumigrid-page.json";

struct PublishedPage {
  std::uint64_t files = 0;
  std::uint64_t bytes_written = 0;
  std::uint64_t pruned = 0;
};

/// Writes the files that are not there already, index.html after all that it names, then the list. `place` is the
/// sink's, to read from.
///
/// index.html is told in its <meta name="lumigrid-scene"> where the scene is, and in <meta name="lumigrid-method">
/// whether it has splats only, so its compressed forms are left out; kInvalidInput where it has no such elements.
/// A file that an earlier call did not write is never replaced: kExists, naming it, before anything is written.
/// `prune` removes files of earlier pages that this one does not have. Otherwise they stay for pages that are open
/// somewhere, but for compressed forms of files that this page has: they would be sent in these files' place.
base::Result<PublishedPage> publishPage(const PageFiles& pages, const std::string& place, repository::ObjectSink& sink,
                                        bool splats_only, bool prune);

}  // namespace server::cli
