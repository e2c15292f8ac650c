// Feeds any bytes to the mesh readers; the first byte chooses the reader. Blocks keep the promises of MeshSink.
#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <array>

#include "base/check.h"
#include "mesh/readers.h"
#include "mesh/tiles/subtree.h"
#include "tests/fuzz/fuzz.h"

namespace {

using namespace mesh;

class CheckingSink : public MeshSink {
 public:
  base::Result<void> vertices(const VertexBlock& block) override {
    LUMIGRID_CHECK(block.normals.empty() || block.normals.size() == block.positions.size());
    LUMIGRID_CHECK(block.colors.empty() || block.colors.size() == block.positions.size());
    vertices_ += block.positions.size();
    return {};
  }
  base::Result<void> triangles(const TriangleBlock& block) override {
    LUMIGRID_CHECK_EQ(block.corners.size() % 3, 0U);
    LUMIGRID_CHECK(block.normals.empty() || block.normals.size() == block.corners.size());
    LUMIGRID_CHECK(block.colors.empty() || block.colors.size() == block.corners.size());
    for (const std::uint64_t corner : block.corners) highest_ = std::max(highest_, corner + 1);
    return {};
  }
  base::Result<void> restart() override {
    vertices_ = highest_ = 0;
    return {};
  }
  void checkWhole() const { LUMIGRID_CHECK_LE(highest_, vertices_); }

 private:
  std::uint64_t vertices_ = 0;
  std::uint64_t highest_ = 0;
};

base::Bytes seed(char reader, const std::string& text) {
  base::Bytes bytes(1 + text.size(), static_cast<std::uint8_t>(reader));
  std::copy(text.begin(), text.end(), bytes.begin() + 1);
  return bytes;
}

std::string binaryPly() {
  std::string s =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  s += std::string(3 * 15, '\1') + '\3';
  for (char i = 0; i < 3; ++i) s += std::string{i, 0, 0, 0};
  return s;
}

std::string binaryStl() {
  std::string s(80, ' ');
  s += std::string{1, 0, 0, 0};
  return s + std::string(50, '\2');
}

// LAS 1.4 with a record of GeoTIFF keys, one of well-known text, and two points of format 7.
std::string las() {
  std::string s(375, '\0');
  s.replace(0, 4, "LASF");
  s[24] = 1, s[25] = 4, s[94] = 0x77, s[95] = 1, s[100] = 2, s[104] = 7, s[105] = 36, s[247] = 2;
  for (std::size_t axis = 0; axis < 3; ++axis) s[131 + 8 * axis + 6] = '\xf0', s[131 + 8 * axis + 7] = 0x3f;
  const auto add = [&s](std::uint16_t number, const std::string& content) {
    s += std::string(2, '\0') + std::string("LASF_Projection\0", 16);
    s += {static_cast<char>(number & 255), static_cast<char>(number >> 8), static_cast<char>(content.size()), 0};
    s += std::string(32, '\0') + content;
  };
  add(34735, std::string("\1\0\1\0\0\0\1\0\0\x0c\0\0\1\0\x64\x7f", 16));
  add(2112, R"(PROJCS["a",GEOGCS["b"],UNIT["metre",1],AUTHORITY["EPSG","32612"]])");
  s[96] = static_cast<char>(s.size() & 255), s[97] = static_cast<char>(s.size() >> 8);
  return s + std::string(36, '\1') + std::string(36, '\2');
}

std::string number(std::size_t n) {
  std::string bytes;
  for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(n >> shift & 255);
  return bytes;
}

std::string glb(std::string text, std::string binary) {
  text.resize((text.size() + 3) / 4 * 4, ' ');
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  return "glTF" + number(2) + number(28 + text.size() + binary.size()) + number(text.size()) + "JSON" + text +
         number(binary.size()) + std::string("BIN\0", 4) + binary;
}

const float kTriangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

// A tile with a centre in its feature table's binary part.
std::string b3dm() {
  const std::string table = R"({"BATCH_LENGTH":0,"RTC_CENTER":{"byteOffset":0}} )";
  std::string points(reinterpret_cast<const char*>(kTriangle), sizeof(kTriangle));
  const std::string model =
      glb(R"({"asset":{"version":"2.0"},"buffers":[{}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":)"
          R"([{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"meshes":[{"primitives":[{"attributes":)"
          R"({"POSITION":0}}]}],"extensions":{"CESIUM_RTC":{"center":[1,2,3]}}})",
          points);
  std::string s = "b3dm";
  for (const std::size_t n : {std::size_t{1}, 28 + table.size() + 12 + model.size(), table.size(), std::size_t{12},
                              std::size_t{0}, std::size_t{0}})
    s += number(n);
  return s + table + points.substr(0, 12) + model;
}

// A subtree of an octree, with two bitstreams.
std::string subtree() {
  const std::string text =
      R"({"buffers":[{"byteLength":24}],"bufferViews":[{"buffer":0,"byteLength":10},{"buffer":0,"byteOffset":10,)"
      R"("byteLength":10}],"tileAvailability":{"bitstream":0},"contentAvailability":[{"bitstream":1},{"constant":1}],)"
      R"("childSubtreeAvailability":{"constant":0}})";
  std::string s = "subt" + number(1);
  for (const std::size_t n : {text.size(), std::size_t{24}}) s += number(n) + number(0);
  return s + text + std::string(24, '\x55');
}

// Asks for all that a subtree may be asked for.
void readSubtree(base::ByteView bytes) {
  tiles::ImplicitTiling tiling;
  tiling.children = 8, tiling.subtree_levels = 3, tiling.available_levels = 6;
  const auto subtree = tiles::Subtree::parse(bytes, "/nowhere/subtree", tiling);
  if (!subtree) return;
  std::uint64_t tiles = 1;
  for (unsigned level = 0; level < tiling.subtree_levels; ++level, tiles *= tiling.children)
    for (std::uint64_t tile = 0; tile < tiles; ++tile)
      if (subtree->hasTile(level, tile)) (void)subtree->hasContent(tile % 3, level, tile);
  for (std::uint64_t below = 0; below < tiles; ++below) (void)subtree->hasChildSubtree(below);
}

// Two points with quantised positions, colours and normals.
std::string pnts() {
  const std::string table =
      R"({"POINTS_LENGTH":2,"POSITION_QUANTIZED":{"byteOffset":0},"QUANTIZED_VOLUME_OFFSET":[1,2,3],)"
      R"("QUANTIZED_VOLUME_SCALE":[1,2,3],"RGB":{"byteOffset":12},"NORMAL_OCT16P":{"byteOffset":18}})";
  std::string s = "pnts";
  for (const std::size_t n :
       {std::size_t{1}, 28 + table.size() + 22, table.size(), std::size_t{22}, std::size_t{0}, std::size_t{0}})
    s += number(n);
  return s + table + std::string(22, '\3');
}

// A GLB whose points and indices are compressed by meshoptimizer.
std::string meshoptGlb() {
  std::array<unsigned char, 512> points{}, indices{};
  const unsigned int corners[3] = {0, 1, 2};
  const std::size_t p = meshopt_encodeVertexBuffer(points.data(), points.size(), kTriangle, 3, 12);
  const std::size_t i = meshopt_encodeIndexBuffer(indices.data(), indices.size(), corners, 3);
  const auto view = [](std::size_t offset, std::size_t length, const char* rest) {
    return R"({"extensions":{"EXT_meshopt_compression":{"buffer":0,"byteOffset":)" + std::to_string(offset) +
           R"(,"byteLength":)" + std::to_string(length) + R"(,"count":3,)" + rest + "}}}";
  };
  const std::string text =
      R"({"asset":{"version":"2.0"},"buffers":[{}],"bufferViews":[)" +
      view(0, p, R"("byteStride":12,"mode":"ATTRIBUTES","filter":"EXPONENTIAL")") + "," +
      view(p, i, R"("byteStride":2,"mode":"TRIANGLES")") +
      R"(],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},{"bufferView":1,)"
      R"("componentType":5123,"count":3,"type":"SCALAR"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},)"
      R"("indices":1}]}]})";
  return glb(text, std::string(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(p)) +
                       std::string(indices.begin(), indices.begin() + static_cast<std::ptrdiff_t>(i)));
}

// A GLB whose triangle is compressed by Draco, by connectivity or in its order.
std::string dracoGlb(bool connectivity) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(1);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  builder.SetAttributeValuesForFace(position, draco::FaceIndex(0), kTriangle, kTriangle + 3, kTriangle + 6);
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(connectivity ? draco::MESH_EDGEBREAKER_ENCODING : draco::MESH_SEQUENTIAL_ENCODING);
  if (connectivity) encoder.SetAttributeQuantization(position, 8);
  draco::EncoderBuffer buffer;
  LUMIGRID_CHECK(encoder.EncodeToBuffer(&buffer).ok());
  const std::string text =
      R"({"asset":{"version":"2.0"},"buffers":[{}],"bufferViews":[{"buffer":0,"byteLength":)" +
      std::to_string(buffer.size()) +
      R"(}],"accessors":[{"componentType":5126,"count":3,"type":"VEC3"}],"meshes":[{"primitives":[{"attributes":)"
      R"({"POSITION":0},"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":)" +
      std::to_string(mesh->attribute(position)->unique_id()) + "}}}}]}]}";
  return glb(text, {buffer.data(), buffer.size()});
}

// A .gltf with everything in its text: a triangle of 16-bit positions, one of which is replaced, colours and a picture.
std::string document() {
  return R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":33,"uri":"data:;base64,)"
         R"(AAAAAAAAAAABAAAAAAAAAAEAAAABAQEBAQEBAQEBAQEB"}],"bufferViews":[{"buffer":0,"byteLength":24,)"
         R"("byteStride":8},{"buffer":0,"byteOffset":20,"byteLength":12}],"accessors":[{"bufferView":0,)"
         R"("componentType":5122,"count":3,"type":"VEC3","sparse":{"count":1,"indices":{"bufferView":1,)"
         R"("componentType":5121},"values":{"bufferView":1,"byteOffset":4}}},{"bufferView":1,"componentType":5121,)"
         R"("count":3,"type":"VEC3","normalized":true}],"materials":[{"pbrMetallicRoughness":{"baseColorTexture":)"
         R"({"index":0,"extensions":{"KHR_texture_transform":{"offset":[0,1],"rotation":1,"scale":[2,2]}}}}}],)"
         R"("textures":[{"source":0}],"images":[{"uri":"data:image/png;base64,iVBORw0KGgo"}],"meshes":[{"primitives":)"
         R"([{"attributes":{"POSITION":0,"COLOR_0":1},"mode":5,"material":0}]}],"nodes":[{"mesh":0,"scale":[1,2,3],)"
         R"("children":[1]},{"mesh":0,"rotation":[0,0,0,1],"extensions":{"EXT_mesh_gpu_instancing":{"attributes":)"
         R"({"TRANSLATION":0,"SCALE":1}}}}],"scenes":[{"nodes":[0]}]})";
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {
      seed(0, binaryPly()),
      seed(0,
           "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 3\nproperty double x\nproperty double y\n"
           "property double z\nelement face 1\nproperty list uchar int vertex_indices\n"
           "property list uchar float texcoord\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1\n"),
      seed(1,
           "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 9\nvn 0 0 1\nvt 0 0\nmtllib a.mtl\nusemtl b\nf 1/1/1 2//1 -1\n"),
      seed(2, binaryStl()),
      seed(2,
           "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "
           "0\nendloop\nendfacet\nendsolid\n"),
      seed(3, "COFF\n3 1 0\n0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n3 0 1 2\n"),
      seed(4, std::string("glTF\2\0\0\0\x7c\0\0\0\x68\0\0\0JSON", 20) +
                  R"({"buffers":[{"byteLength":0}],)"
                  R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[]} )"),
      seed(4, document()),
      seed(4, meshoptGlb()),
      seed(4, dracoGlb(true)),
      seed(4, dracoGlb(false)),
      seed(4, R"({"asset":{"version":"1.1","gltfUpAxis":"Z"},"root":{"refine":"ADD","boundingVolume":{"box":[0,0,0]},)"
              R"("transform":[1,0,0,0,0,1,0,0,0,0,1,0,9,9,9,1],"content":{"uri":"a.b3dm"},"children":[{"contents":)"
              R"([{"uri":"b%20.json?c"}],"implicitTiling":{"subdivisionScheme":"OCTREE","subtreeLevels":2,)"
              R"("availableLevels":3,"subtrees":{"uri":"{level}/{x}{y}{z}"}}}]}})"),
      seed(6, subtree()),
      seed(6, pnts()),
      seed(6, b3dm()),
      seed(5, las()),
      seed(7, "2\n1 2 3 -7 255 0 9\r\n4 5e1 6 0 1 2 3\n1\n7 8 9 0 1 2 3\n"),
      seed(7,
           "\xEF\xBB\xBF//X,Y,Z,Nx,Ny,Nz,Red,Green,Blue,Label\n# "
           "a\n1.5,2,-3,0,0,1,0.5,0,1.0,wall\n1,2,3,nan,0,0,2,2,2,a\n"),
      seed(7, "1;2;3;-0.6;0.8;0\n4;5;6;0;0;0;\n"),
      seed(8,
           "1\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n9 9 9 1\n1 2 3 0.5 9 0 0\n0 0 0 0.5 0 0 0\n"
           "1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n9 9 9 1\n1 nan 3 -5\n")};
}

void fuzzOne(base::ByteView bytes) {
  if (bytes.empty()) return;
  const base::ByteView file = bytes.subspan(1);
  CheckingSink sink;
  MeshStream stream(sink, file, "/nowhere/mesh", nullptr);
  stream.accepts_points = true;
  base::Result<void> read;
  switch (bytes[0] % 9) {
    case 0:
      read = readPly(file, stream);
      break;
    case 1:
      read = readObj(file, stream);
      break;
    case 2:
      read = readStl(file, stream);
      break;
    case 3:
      read = readOff(file, stream);
      break;
    case 5:
      read = readLas(file, stream);
      break;
    case 6:
      if (textOf(file).substr(0, 4) == "subt") return readSubtree(file);
      read = readTile(file, stream);
      break;
    case 7:
      read = readXyz(file, stream);
      break;
    case 8:
      read = readPtx(file, stream);
      break;
    default:
      read = looksLikeJson(textOf(file)) ? readJson(file, stream) : readGlb(file, stream);
  }
  if (read) sink.checkWhole();
}

}  // namespace fuzz
