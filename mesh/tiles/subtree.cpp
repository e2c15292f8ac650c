#include "mesh/tiles/subtree.h"

#include <filesystem>

#include "mesh/mesh_stream.h"
#include "mesh/uri.h"

namespace mesh::tiles {
namespace {

using gltf::extension;
using gltf::integer;
using gltf::item;
using gltf::itemsOf;
using gltf::json;
using gltf::kMissing;
using gltf::member;

constexpr const char* kExtension = "3DTILES_implicit_tiling";
// A subtree's bits and a tile's coordinates are counted in 64 bits. Real subtrees have less than 10 levels.
constexpr std::uint64_t kMaxSubtreeLevels = 20;
constexpr std::uint64_t kMaxLevels = 62;

std::uint64_t power(std::uint64_t base, unsigned exponent) {
  std::uint64_t result = 1;
  for (unsigned i = 0; i < exponent; ++i) result *= base;
  return result;
}

// The tiles of so many levels of a full tree.
std::uint64_t tilesOf(unsigned children, unsigned levels) {
  return (power(children, levels) - 1) / (children - 1);
}

}  // namespace

bool isImplicit(const json& tile) {
  return member(tile, "implicitTiling").is_object() || extension(tile, kExtension).is_object();
}

base::Result<ImplicitTiling> ImplicitTiling::of(const json& tile) {
  const json& newer = member(tile, "implicitTiling");
  const json& source = newer.is_object() ? newer : extension(tile, kExtension);
  ImplicitTiling tiling;
  const std::string scheme = gltf::text(member(source, "subdivisionScheme"));
  if (scheme != "QUADTREE" && scheme != "OCTREE")
    return unsupported("implicit tiling has the scheme " + inQuotes(scheme) + " (QUADTREE and OCTREE are read)");
  tiling.children = scheme == "OCTREE" ? 8 : 4;
  const std::uint64_t in_subtree = integer(member(source, "subtreeLevels"), 0);
  // The extension's first version counted from 0.
  const json& maximum = member(source, "maximumLevel");
  const std::uint64_t levels = maximum.is_null() ? integer(member(source, "availableLevels"), 0)
                                                 : std::min(integer(maximum, kMaxLevels), kMaxLevels) + 1;
  if (in_subtree < 1 || in_subtree > kMaxSubtreeLevels)
    return invalidInput("implicit tiling has subtreeLevels that are not 1 to " + std::to_string(kMaxSubtreeLevels));
  if (levels < 1 || levels > kMaxLevels)
    return invalidInput("implicit tiling has availableLevels that are not 1 to " + std::to_string(kMaxLevels));
  tiling.subtree_levels = static_cast<unsigned>(in_subtree);
  tiling.available_levels = static_cast<unsigned>(levels);
  tiling.subtrees = gltf::text(member(member(source, "subtrees"), "uri"));
  if (tiling.subtrees.empty()) return invalidInput("implicit tiling has no uri of its subtrees");
  return tiling;
}

TileCoordinates TileCoordinates::child(unsigned c) const {
  TileCoordinates tile{level + 1, {}};
  for (std::size_t axis = 0; axis < at.size(); ++axis) tile.at[axis] = 2 * at[axis] + (c >> axis & 1U);
  return tile;
}

std::string nameFromTemplate(std::string_view text, const TileCoordinates& tile) {
  const std::pair<std::string_view, std::uint64_t> variables[] = {
      {"{level}", tile.level}, {"{x}", tile.at[0]}, {"{y}", tile.at[1]}, {"{z}", tile.at[2]}};
  std::string name;
  while (!text.empty()) {
    bool found = false;
    for (const auto& [variable, value] : variables) {
      if (text.substr(0, variable.size()) != variable) continue;
      name += std::to_string(value);
      text.remove_prefix(variable.size());
      found = true;
      break;
    }
    if (found) continue;
    name += text.front();
    text.remove_prefix(1);
  }
  return name;
}

bool tellsTilesApart(const std::string& text, const ImplicitTiling& tiling) {
  if (tiling.available_levels == 1) return true;
  // A query or a ".." may drop a coordinate, so whole names are compared.
  const auto file = [&text](const TileCoordinates& tile) {
    return std::filesystem::path(fileOfReference({}, nameFromTemplate(text, tile))).lexically_normal();
  };
  const auto first = file({1, {}});
  if (file({2, {}}) == first) return false;
  for (std::size_t axis = 0; axis < (tiling.children == 8 ? 3U : 2U); ++axis) {
    TileCoordinates other{1, {}};
    other.at[axis] = 1;
    if (file(other) == first) return false;
  }
  return true;
}

base::Result<Subtree> Subtree::open(const std::string& path, const ImplicitTiling& tiling) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::MappedFile::open(path));
  auto subtree = parse(file.bytes(), path, tiling);
  if (!subtree) return base::within(path, subtree.error());
  subtree->file_ = std::move(file);
  return subtree;
}

base::Result<Subtree> Subtree::parse(base::ByteView bytes, const std::string& path, const ImplicitTiling& tiling) {
  Subtree subtree;
  subtree.tiling_ = tiling;
  subtree.path_ = path;
  // Subtrees are JSON alone, or JSON and a buffer behind a header of 24 bytes (section "Subtree File Format").
  base::ByteView text = bytes;
  if (textOf(bytes).substr(0, 4) == "subt") {
    base::ByteReader reader(bytes);
    (void)reader.u32();  // "subt"
    const std::uint32_t version = reader.u32();
    const std::uint64_t json_bytes = reader.u64();
    const std::uint64_t binary_bytes = reader.u64();
    if (!reader.ok()) return truncatedIn("a subtree's header");
    if (version != 1) return unsupported("version " + std::to_string(version) + " of subtrees is not read (only 1 is)");
    const std::uint64_t rest = bytes.size() - reader.offset();
    if (json_bytes > rest || binary_bytes > rest - json_bytes) return truncatedIn("a subtree");
    text = reader.bytes(static_cast<std::size_t>(json_bytes));
    subtree.binary_ = reader.bytes(static_cast<std::size_t>(binary_bytes));
  }
  subtree.root_ = json::parse(text.begin(), text.end(), nullptr, false);
  if (!subtree.root_.is_object()) return invalidInput("the JSON of the subtree is broken (truncated?)");
  const json& root = subtree.root_;
  const std::uint64_t tiles = tilesOf(tiling.children, tiling.subtree_levels);
  LUMIGRID_ASSIGN_OR_RETURN(subtree.tiles_,
                            subtree.availability(member(root, "tileAvailability"), "tileAvailability", tiles));
  const std::uint64_t below = power(tiling.children, tiling.subtree_levels);
  LUMIGRID_ASSIGN_OR_RETURN(subtree.subtrees_, subtree.availability(member(root, "childSubtreeAvailability"),
                                                                    "childSubtreeAvailability", below));
  // The extension of version 1.0 has an object in place of a list of one, and lists in an extension.
  const json& several = member(extension(root, "3DTILES_multiple_contents"), "contentAvailability");
  const json& contents = several.is_array() ? several : member(root, "contentAvailability");
  const std::size_t count = contents.is_object() ? 1 : itemsOf(contents);
  for (std::size_t c = 0; c < count; ++c) {
    const json& source = contents.is_object() ? contents : contents[c];
    LUMIGRID_ASSIGN_OR_RETURN(const auto content, subtree.availability(source, "contentAvailability", tiles));
    subtree.contents_.push_back(content);
  }
  return subtree;
}

std::uint64_t Subtree::tileBit(unsigned level, std::uint64_t morton) const {
  return tilesOf(tiling_.children, level) + morton;
}

base::Result<Subtree::Availability> Subtree::availability(const json& source, const std::string& what,
                                                          std::uint64_t bits) {
  if (const json& constant = member(source, "constant"); !constant.is_null())
    return Availability{{}, integer(constant, 0) == 1};
  const json& newer = member(source, "bitstream");
  const std::uint64_t view = integer(newer.is_null() ? member(source, "bufferView") : newer, kMissing);
  const json& place = item(member(root_, "bufferViews"), view);
  if (!place.is_object()) return invalidInput(what + " has neither a constant nor a bitstream that is there");
  LUMIGRID_ASSIGN_OR_RETURN(const base::ByteView bytes, buffer(integer(member(place, "buffer"), kMissing)));
  const std::uint64_t offset = integer(member(place, "byteOffset"), 0);
  const std::uint64_t length = integer(member(place, "byteLength"), 0);
  if (offset > bytes.size() || length > bytes.size() - offset)
    return invalidInput(what + " reaches past its buffer of " + std::to_string(bytes.size()) + " bytes");
  if (length < (bits + 7) / 8)
    return invalidInput(what + " has " + std::to_string(length) + " bytes, " + std::to_string(bits) +
                        " bits are needed");
  return Availability{bytes.subspan(static_cast<std::size_t>(offset), static_cast<std::size_t>(length)), false};
}

base::Result<base::ByteView> Subtree::buffer(std::uint64_t index) {
  const json& source = item(member(root_, "buffers"), index);
  if (!source.is_object()) return invalidInput("a bitstream names a buffer that is not there");
  const std::string uri = gltf::text(member(source, "uri"));
  if (uri.empty()) return binary_;
  if (isRemote(uri) || isDataUri(uri)) return unsupported("its buffer is no file on this machine: " + inQuotes(uri));
  const std::string path = fileOfReference(path_, uri);
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::MappedFile::open(path));
  outside_.push_back(std::move(file));
  return outside_.back().bytes();
}

}  // namespace mesh::tiles
