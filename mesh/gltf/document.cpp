#include "mesh/gltf/document.h"

#include <algorithm>
#include <string_view>

#include "mesh/gltf/meshopt.h"
#include "mesh/mesh_stream.h"
#include "mesh/uri.h"

namespace mesh::gltf {
namespace {

constexpr std::uint32_t kMagic = 0x46546C67;      // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;  // "JSON"
constexpr std::uint32_t kBinChunk = 0x004E4942;   // "BIN\0"

std::size_t componentsOf(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  return type == "VEC4" ? 4 : 0;
}

constexpr std::size_t kKeptBytes = std::size_t{1} << 30;  // a choice: 60 million vertices with normals and colours

base::Error reachesPast(const std::string& here) {
  return invalidInput(here + " reaches past its buffer (truncated?)");
}

}  // namespace

base::Result<Document> Document::parse(base::ByteView bytes, std::string path, std::uint64_t offset) {
  if (base::textOf(bytes).substr(0, 4) != "glTF") {
    json parsed = json::parse(bytes.begin(), bytes.end(), nullptr, false);
    if (!parsed.is_object()) return invalidInput("the JSON is broken (truncated?)");
    return ofJson(std::move(parsed), bytes, std::move(path));
  }
  Document document;
  document.path_ = std::move(path);
  document.offset_ = offset;
  document.file_ = bytes;
  document.total_bytes_ = bytes.size();
  LUMIGRID_TRY(document.splitChunks(bytes));
  return document;
}

base::Result<Document> Document::ofJson(json parsed, base::ByteView bytes, std::string path) {
  Document document;
  document.path_ = std::move(path);
  document.file_ = document.text_ = bytes;
  document.total_bytes_ = bytes.size();
  document.root_ = std::move(parsed);
  const json& asset = member(document.root_, "asset");
  if (!asset.is_object()) return invalidInput("the JSON is not glTF: it has no \"asset\"");
  const std::string version = text(member(asset, "version"));
  if (!version.empty() && version.front() != '2')
    return unsupported("glTF version " + inQuotes(version) + " is not read (only 2 is)");
  return document;
}

// A 12-byte header is followed by chunks, each of length, type and bytes (section 4.4).
base::Result<void> Document::splitChunks(base::ByteView bytes) {
  base::ByteReader reader(bytes);
  const std::uint32_t magic = reader.u32();
  const std::uint32_t version = reader.u32();
  const std::uint32_t length = reader.u32();
  if (!reader.ok() || magic != kMagic) return invalidInput("not a GLB file: it does not begin with \"glTF\"");
  if (version != 2) return unsupported("glTF version " + std::to_string(version) + " is not read (only 2 is)");
  if (length > bytes.size())
    return truncatedIn("byte " + std::to_string(bytes.size()) + " of " + std::to_string(length));

  while (reader.ok() && reader.offset() + 8 <= length) {
    const std::uint32_t chunk_length = reader.u32();
    const std::uint32_t type = reader.u32();
    const std::size_t begin = reader.offset();
    const base::ByteView chunk = reader.bytes(chunk_length);
    if (!reader.ok()) return truncatedIn("a chunk of " + std::to_string(chunk_length) + " bytes");
    if (type == kJsonChunk && text_.empty()) {
      text_ = chunk;
      root_ = json::parse(chunk.begin(), chunk.end(), nullptr, false);
    } else if (type == kBinChunk && binary_.empty()) {
      binary_ = chunk;
      binary_offset_ = offset_ + begin;
    }
  }
  if (!root_.is_object()) return invalidInput("the JSON chunk is missing or broken");
  return {};
}

// Opens a buffer the first time that something lies in it.
base::Result<const Document::Buffer*> Document::buffer(std::uint64_t index, const std::string& here) {
  if (const auto known = buffers_.find(index); known != buffers_.end()) return &known->second;
  const json& source = item(list("buffers"), index);
  const std::string uri = text(member(source, "uri"));
  Buffer opened;
  if (uri.empty()) {
    // Only the first buffer is the GLB's BIN chunk (section 4.4.3.3).
    if (index != 0 || (!source.is_object() && binary_.empty()))
      return invalidInput(here + " lies in a buffer that is not there");
    opened.bytes = binary_;
    opened.path = path_;
    opened.offset = binary_offset_;
  } else if (isDataUri(uri)) {
    auto bytes = bytesOfDataUri(uri);
    if (!bytes) return invalidInput(here + " lies in a data URI that is broken");
    opened.decoded = std::move(*bytes);
    opened.bytes = opened.decoded;
  } else if (isRemote(uri)) {
    return unsupported(here + " lies at " + inQuotes(uri) + ", which is not fetched; put the file beside this one");
  } else {
    opened.path = fileOfReference(path_, uri);
    LUMIGRID_ASSIGN_OR_RETURN(opened.map, base::MappedFile::open(opened.path));
    opened.bytes = opened.map.bytes();
    total_bytes_ += opened.bytes.size();
  }
  return &buffers_.emplace(index, std::move(opened)).first->second;
}

base::Result<View> Document::view(std::uint64_t index, const std::string& here) {
  const json& source = item(list("bufferViews"), index);
  if (!source.is_object()) return invalidInput(here + " has no buffer view");
  const json& compression = meshoptOf(source);
  return compression.is_object() ? decodedView(index, compression, here) : plainView(source, here);
}

// Meshes often share views, so that decoded ones are kept up to a ceiling.
base::Result<View> Document::decodedView(std::uint64_t index, const json& compression, const std::string& here) {
  const auto known = std::find_if(decoded_.begin(), decoded_.end(), [&](const auto& d) { return d.index == index; });
  if (known != decoded_.end()) {
    std::rotate(known, known + 1, decoded_.end());
    return decoded_.back().view;
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto compressed, plainView(compression, here));
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, decodeMeshopt(compression, compressed.bytes, here));
  const auto owner = std::make_shared<const base::Bytes>(std::move(bytes));
  // The stride is the compression's, but for indices, which stand without gaps.
  decoded_.push_back({index, {*owner, compressed.stride, owner}});
  std::size_t kept = 0;
  for (const DecodedView& d : decoded_) kept += d.view.bytes.size();
  while (kept > kKeptBytes && decoded_.size() > 1) {
    kept -= decoded_.front().view.bytes.size();
    decoded_.erase(decoded_.begin());
  }
  return decoded_.back().view;
}

// The part of a buffer that `source`, a buffer view or a compression's object, names.
base::Result<View> Document::plainView(const json& source, const std::string& here) {
  LUMIGRID_ASSIGN_OR_RETURN(const Buffer* whole, buffer(integer(member(source, "buffer"), kMissing), here));
  const std::uint64_t offset = integer(member(source, "byteOffset"), 0);
  const std::uint64_t length = integer(member(source, "byteLength"), 0);
  if (offset > whole->bytes.size() || length > whole->bytes.size() - offset) return reachesPast(here);
  const auto bytes = whole->bytes.subspan(static_cast<std::size_t>(offset), static_cast<std::size_t>(length));
  return View{bytes, integer(member(source, "byteStride"), 0), nullptr};
}

base::Result<Accessor> Document::accessorType(std::uint64_t index, const std::string& here) const {
  const json& source = item(list("accessors"), index);
  if (!source.is_object()) return invalidInput(here + " is not there");
  Accessor type;
  type.count = integer(member(source, "count"), 0);
  type.component_type = integer(member(source, "componentType"), 0);
  type.components = componentsOf(text(member(source, "type")));
  type.normalized = member(source, "normalized") == json(true);
  if (type.elementBytes() == 0) return invalidInput(here + " has an unknown type");
  if (type.count == 0) return invalidInput(here + " has no elements");
  return type;
}

base::Result<Accessor> Document::accessor(std::uint64_t index, const std::string& place) {
  const std::string here = place + ": accessor " + std::to_string(index);
  LUMIGRID_ASSIGN_OR_RETURN(auto result, accessorType(index, here));
  const json& source = item(list("accessors"), index);
  const json& sparse = member(source, "sparse");
  const std::size_t element = result.elementBytes();

  const json& view_index = member(source, "bufferView");
  if (view_index.is_null() && sparse.is_object()) {
    if (result.count > kMaxSparseBase)
      return unsupported(here + " is sparse and has more than " + std::to_string(kMaxSparseBase) + " elements");
    const auto zeros = std::make_shared<base::Bytes>(static_cast<std::size_t>(result.count) * element);
    result.data = zeros->data();
    result.stride = element;
    result.owner = zeros;
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(const auto lies, view(integer(view_index, kMissing), here));
    const std::uint64_t offset = integer(member(source, "byteOffset"), 0);
    const std::uint64_t length = lies.bytes.size();
    const std::uint64_t stride = lies.stride == 0 ? element : lies.stride;
    // A stride has at most 252 bytes (section 5.11.4), from one element's begin to the next.
    if (stride < element || stride > 252 + element || offset > length || length - offset < element ||
        (length - offset - element) / stride < result.count - 1)
      return reachesPast(here);
    result.stride = static_cast<std::size_t>(stride);
    result.data = lies.bytes.data() + offset;
    result.owner = lies.owner;
  }
  if (sparse.is_object()) LUMIGRID_TRY(fillIn(sparse, result, here));
  return result;
}

// Replaces single elements of an accessor (section 3.6.2.3), which becomes a copy without gaps.
base::Result<void> Document::fillIn(const json& sparse, Accessor& accessor, const std::string& here) {
  const std::size_t element = accessor.elementBytes();
  const auto dense = std::make_shared<base::Bytes>(static_cast<std::size_t>(accessor.count) * element);
  for (std::uint64_t i = 0; i < accessor.count; ++i)
    std::memcpy(dense->data() + i * element, accessor.data + i * accessor.stride, element);

  const std::uint64_t count = integer(member(sparse, "count"), 0);
  const json& where = member(sparse, "indices");
  const json& what = member(sparse, "values");
  LUMIGRID_ASSIGN_OR_RETURN(const auto index_view, view(integer(member(where, "bufferView"), kMissing), here));
  LUMIGRID_ASSIGN_OR_RETURN(const auto value_view, view(integer(member(what, "bufferView"), kMissing), here));
  Accessor indices;
  indices.component_type = integer(member(where, "componentType"), 0);
  indices.components = 1;
  indices.stride = indices.elementBytes();
  if (!indices.isIndex()) return invalidInput(here + " has sparse indices that are not unsigned integers");
  const std::uint64_t index_offset = integer(member(where, "byteOffset"), 0);
  const std::uint64_t value_offset = integer(member(what, "byteOffset"), 0);
  if (index_offset > index_view.bytes.size() || value_offset > value_view.bytes.size() ||
      (index_view.bytes.size() - index_offset) / indices.stride < count ||
      (value_view.bytes.size() - value_offset) / element < count)
    return reachesPast(here);
  indices.data = index_view.bytes.data() + index_offset;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint32_t at = indices.index(i);
    if (at >= accessor.count) return invalidInput(here + " is sparse and has an index that is out of range");
    std::memcpy(dense->data() + at * element, value_view.bytes.data() + value_offset + i * element, element);
  }
  accessor.data = dense->data();
  accessor.stride = element;
  accessor.owner = dense;
  return {};
}

base::Result<SourcePicture> Document::picture(std::uint64_t image) {
  const json& source = item(list("images"), image);
  const std::string uri = text(member(source, "uri"));
  if (isDataUri(uri)) return pictureInText(uri);
  if (isRemote(uri)) return unsupported("it lies at " + inQuotes(uri) + ", which is not fetched");
  if (!uri.empty()) return SourcePicture{fileOfReference(path_, uri), 0, 0};

  const json& view_source = item(list("bufferViews"), integer(member(source, "bufferView"), kMissing));
  if (!view_source.is_object()) return invalidInput("it is not in the file");
  LUMIGRID_ASSIGN_OR_RETURN(const auto view, plainView(view_source, "it"));
  LUMIGRID_ASSIGN_OR_RETURN(const Buffer* whole, buffer(integer(member(view_source, "buffer"), kMissing), "it"));
  if (view.bytes.empty()) return invalidInput("it is not in the file");
  if (whole->path.empty()) return unsupported("it lies in a buffer that is text; write the file as GLB");
  const auto begin = static_cast<std::uint64_t>(view.bytes.data() - whole->bytes.data());
  return SourcePicture{whole->path, whole->offset + begin, view.bytes.size()};
}

// Finds a picture that is text within the JSON. Any place where the same text stands has the same picture.
base::Result<SourcePicture> Document::pictureInText(const std::string& uri) {
  const std::string_view base64 = base64Of(uri);
  if (base64.empty()) return unsupported("it is text, but not in base64");
  const std::string_view whole = base::textOf(text_);
  std::string written(base64);
  std::size_t at = whole.find(written, searched_);
  if (at == std::string_view::npos) at = whole.find(written);
  if (at == std::string_view::npos) {
    // JSON may write "\/" for "/".
    written.clear();
    for (const char c : base64) written += c == '/' ? std::string("\\/") : std::string(1, c);
    at = whole.find(written);
  }
  if (at == std::string_view::npos) return unsupported("it is text that is written with JSON's escapes");
  searched_ = at + written.size();
  const auto text_begin = static_cast<std::uint64_t>(text_.data() - file_.data());
  return SourcePicture{path_, offset_ + text_begin + at, written.size(), true};
}

}  // namespace mesh::gltf
