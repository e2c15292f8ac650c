#pragma once
// A glTF 2.0 document: its JSON, its buffers inside and outside of the file, and what accessors and pictures find in
// them. Section numbers in the source refer to the Khronos specification.
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "mesh/gltf/accessor.h"
#include "mesh/gltf/json_values.h"
#include "mesh/stream_mesh.h"

namespace mesh::gltf {

/// A sparse accessor may stand on zeros that take no place in the file, and a small hostile file must not fill the
/// memory: more are an error. A choice, with 2^24 vertices for the largest that is plausible.
inline constexpr std::uint64_t kMaxSparseBase = std::uint64_t{1} << 24;

/// The bytes of a buffer view (section 3.6.1).
struct View {
  base::ByteView bytes;
  std::uint64_t stride = 0;                  ///< 0: elements stand without gaps
  std::shared_ptr<const base::Bytes> owner;  ///< of bytes that were decoded; else null
};

class Document {
 public:
  /// Reads the JSON of a GLB or of a .gltf file. `bytes` must outlive the document. They are those of the file `path`,
  /// beside which outside buffers and pictures lie; a GLB may begin at `offset` in it.
  static base::Result<Document> parse(base::ByteView bytes, std::string path, std::uint64_t offset = 0);
  /// The same with the JSON of a .gltf file that has been parsed already.
  static base::Result<Document> ofJson(json parsed, base::ByteView bytes, std::string path);

  const json& root() const { return root_; }
  /// The items of a list at the top, "nodes"; null where it is missing.
  const json& list(const char* name) const { return member(root_, name); }
  /// The bytes of the file and of all outside buffers that have been opened.
  std::uint64_t bytes() const { return total_bytes_; }

  /// Errors begin with `place` and the accessor's number; those of an outside file name it, too.
  base::Result<Accessor> accessor(std::uint64_t index, const std::string& place);
  /// Type, components and count alone, as accessors of compressed primitives have them.
  base::Result<Accessor> accessorType(std::uint64_t index, const std::string& here) const;
  /// The bytes of a view, decoded where they are compressed.
  base::Result<View> view(std::uint64_t index, const std::string& here);
  /// Where the bytes of an image lie; an error says why there are none.
  base::Result<SourcePicture> picture(std::uint64_t image);

 private:
  struct Buffer {
    base::ByteView bytes;
    std::string path;  // the file that holds the bytes as they are; empty: none does
    std::uint64_t offset = 0;
    base::MappedFile map;
    base::Bytes decoded;
  };

  base::Result<void> splitChunks(base::ByteView bytes);
  base::Result<const Buffer*> buffer(std::uint64_t index, const std::string& here);
  struct DecodedView {
    std::uint64_t index = 0;
    View view;
  };
  base::Result<View> decodedView(std::uint64_t index, const json& compression, const std::string& here);
  base::Result<View> plainView(const json& source, const std::string& here);
  base::Result<void> fillIn(const json& sparse, Accessor& accessor, const std::string& here);
  base::Result<SourcePicture> pictureInText(const std::string& uri);

  json root_;
  std::string path_;
  std::uint64_t offset_ = 0;
  base::ByteView file_;
  base::ByteView text_;  // the JSON as it stands in the file
  base::ByteView binary_;
  std::uint64_t binary_offset_ = 0;
  std::uint64_t total_bytes_ = 0;
  std::map<std::uint64_t, Buffer> buffers_;
  std::vector<DecodedView> decoded_;  // in the order of their last use
  std::size_t searched_ = 0;          // as far as pictures were found in the text
};

}  // namespace mesh::gltf
