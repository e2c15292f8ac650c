#pragma once
// The parameters that a store records in its meta text, and the sampling points and tiles that were chosen by use
// beside them (docs/formats/repository.md, "Parameters", "Tree of sampling points" and "Tiles by use").
#include <cstdint>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/wanted_tiles.h"

namespace repository {

/// The grid that a meta text records, as server::bake writes it:
/// {"grid": {"first": [x, y, z], "spacing": s, "count": [nx, ny, nz], "face_size": pixels, "tile_depth": depth}, …}.
/// Errors name the store by `name`.
base::Result<Grid> gridFromMeta(const std::string& meta, const std::string& name);

/// Adds the tree as one more line to `parameters`, a JSON object with one parameter a line.
std::string withTree(const std::string& parameters, const SampleTree& tree);
/// Adds the tiles as one more line after that of the tree.
std::string withTiles(const std::string& text, const Grid& grid, const WantedTiles& tiles);
/// Removes the line of the tree and that of the tiles.
std::string withoutSelection(const std::string& text);
/// Removes the line of the tiles, which matters to builds alone.
std::string withoutTiles(const std::string& text);
/// The text that is published for a meta text: without the tiles, and with the tree in its published form. A text whose
/// grid or tree cannot be read keeps its tree.
std::string publishedParameters(const std::string& meta);
/// The tree that the text holds; nothing where the whole grid is sampled. Errors name the store by `name`.
base::Result<std::optional<SampleTree>> treeFromText(const std::string& text, const Grid& grid,
                                                     const std::string& name);

/// The tiles that the text holds; nothing where all are wanted. Errors name the store by `name`.
base::Result<std::optional<WantedTiles>> tilesFromText(const std::string& text, const Grid& grid,
                                                       const std::string& name);

/// The codec of the images, "jpeg" or "webp", as the text names it; "jpeg" where it names none.
std::string codecFromMeta(const std::string& meta);

/// The grid together with the tree that the text may hold.
base::Result<SampledPoints> sampledPointsFromMeta(const std::string& meta, const std::string& name);

/// The first line in which two meta texts differ: "quality": 85, now "quality": 90. For texts that differ only in their
/// selections it is "other sampling points".
std::string firstDifference(const std::string& stored, const std::string& wanted);

}  // namespace repository
