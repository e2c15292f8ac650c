#pragma once
// The browser client beside a published scene, so that the place opens in a browser with no server of ours.
#include <cstdint>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"
#include "server/net/page_files.h"

namespace server::cli {

/// Lists the page's files at the place, each with its SHA-256: what may be replaced, and what is somebody else's.
inline constexpr const char* kPageList = "lumigrid-page.json";

struct PublishedPage {
  std::uint64_t files = 0;
  std::uint64_t bytes_written = 0;
  std::uint64_t pruned = 0;
};

/// index.html is told where its scene is, in the <meta name="lumigrid-scene"> that the page reads, and in
/// <meta name="lumigrid-method"> that it has splats only; so its compressed forms are left out. kInvalidInput where it
/// has none.
/// Writes what is not there already, index.html after all that it names, then the list. Never replaces what an earlier
/// call did not write: kExists, naming it, before anything is written. `place` is the sink's, to read from. `prune`:
/// removes files of earlier pages that this one has not; otherwise they stay for pages that are open somewhere, but for
/// compressed forms of files that this one has: they would be sent in these files' place.
base::Result<PublishedPage> publishPage(const PageFiles& pages, const std::string& place, repository::ObjectSink& sink,
                                        bool splats_only, bool prune);

}  // namespace server::cli
