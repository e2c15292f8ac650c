// Bad input is an error of one line that names the file and the place; it never crashes or loses a part of the mesh.
#include <cstdio>

#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh_files;

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::string asciiPly(const std::string& vertices, int vertex_count, const std::string& faces, int face_count) {
  return "ply\nformat ascii 1.0\nelement vertex " + std::to_string(vertex_count) +
         "\nproperty float x\nproperty float y\nproperty float z\nelement face " + std::to_string(face_count) +
         "\nproperty list uchar int vertex_indices\nend_header\n" + vertices + faces;
}

const std::string kThree = "0 0 0\n1 0 0\n0 1 0\n";

TEST(BadInput, isNamedInOneLine) {
  const struct {
    std::string name, bytes, message;
  } cases[] = {
      {"a.ply", "", "a.ply: the file is empty"},
      {"a.dat", "hello world", "neither the content nor the name is that of a mesh"},
      {"a.ply", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n",
       "a.ply: it only says where Git LFS"},
      {"a.gltf", "{\"asset\":{}}", "the file has no triangles"},
      {"a.gltf", "{\"asset\":{\"version\":\"1.0\"}}", "glTF version \"1.0\" is not read (only 2 is)"},
      {"a.gltf", "{\"asset\":{}", "the JSON is broken (truncated?)"},
      {"a.json", "{\"rows\":1}", "the JSON is not glTF"},
      {"a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "the header has no end_header line"},
      {"a.ply", "ply\nformat ascii_art 1.0\nend_header\n", "header: unknown format \"ascii_art\""},
      {"a.ply", "ply\nformat ascii 1.0\nelement vertex x\nend_header\n",
       "header: element \"vertex\" has the count \"x\""},
      {"a.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty quad x\nend_header\n",
       "header: unknown type \"quad\""},
      {"a.ply", "ply\nformat ascii 1.0\nproperty float x\nend_header\n", "a property stands before the first element"},
      {"a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 1\nend_header\n0 0\n",
       "the vertex element has no x, y and z"},
      {"a.ply", asciiPly(kThree, 3, "", 0), "the file has no faces (a point cloud?)"},
      {"a.ply", asciiPly(kThree, 3, "3 0 1 9\n", 1), "a.ply: face 0: index 9 is out of range (3 vertices)"},
      {"a.ply", asciiPly(kThree, 3, "3 0 1 2\n3 0 -1 2\n", 2), "a.ply: face 1: index -1 is out of range (3 vertices)"},
      {"a.ply", asciiPly("0 0 0\n1 zero 0\n0 1 0\n", 3, "3 0 1 2\n", 1), "vertex 1: \"zero\" is not a number"},
      {"a.ply", asciiPly(kThree, 3, "3 0 1", 1), "truncated: the file ends in face 0 of 1"},
      {"a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n# c\nf 1 2 9\n", "a.obj: line 5: index 9 is out of range (3 vertices)"},
      {"a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "line 4: index 0 is out of range (3 vertices)"},
      {"a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n", "line 4: index -4 is out of range (3 vertices)"},
      {"a.obj", "v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "line 2: \"x\" is not a number"},
      {"a.obj", "v 0 0 0\nv 1 0\n", "line 2: three numbers are needed"},
      {"a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 2//1 3//1\n", "names a normal that is not there (0 normals)"},
      {"a.obj", "v 0 0 0\nv 1 0 0\n", "the file has no faces (a point cloud?)"},
      {"a.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n",
       "truncated: the file ends in line 5"},
      {"a.stl", "solid a\nendsolid a\n", "the file has no triangles"},
      {"a.stl", "solid a\nfacet\nvertex 0 0 q\n", "line 3: \"q\" is not a number"},
      {"a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "a.off: face 0: index 3 is out of range (3 vertices)"},
      {"a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", "truncated: the file ends in vertex 2 of 3"},
      {"a.off", "4OFF\n3 1 0\n", "\"4OFF\" is not read (only three coordinates are)"},
      {"a.off", "OFF BINARY\n", "binary OFF is not read"},
      {"a.glb", "glTF", "not a GLB file"},
      {"a.glb", std::string("glTF\x01\0\0\0\x0c\0\0\0", 12), "glTF version 1 is not read (only 2 is)"},
      {"a.glb", std::string("glTF\x02\0\0\0\xff\0\0\0", 12), "truncated: the file ends in byte 12 of 255"},
      {"a.glb", std::string("glTF\x02\0\0\0\x0c\0\0\0", 12), "the JSON chunk is missing or broken"},
  };
  for (const auto& c : cases) {
    const std::string message = errorOf(c.name, c.bytes);
    EXPECT_TRUE(contains(message, c.message)) << "got:    " << message << "\nwanted: " << c.message;
  }
}

TEST(BadInput, missingFilesAreNotFound) {
  auto result = support::readMesh("/nowhere/scan.ply");
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, base::ErrorCode::kNotFound);
  EXPECT_TRUE(contains(result.error().message, "/nowhere/scan.ply"));
}

TEST(BadInput, hostileCountsAllocateNothing) {
  // Each claims far more than the file holds (and than this machine's memory).
  const std::string huge = "4294967290";
  EXPECT_TRUE(contains(errorOf("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex " + huge +
                                            "\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
                                            "property list uchar int vertex_indices\nend_header\n"),
                       "truncated: the file ends in vertex 0 of 4294967290"));
  EXPECT_TRUE(
      contains(errorOf("a.ply",
                       "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\n"
                       "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"),
               "truncated: the file ends in vertex 0 of 99999999999"));
  EXPECT_TRUE(contains(errorOf("a.off", "OFF\n" + huge + " 1 0\n0 0 0\n"), "truncated"));
  EXPECT_TRUE(contains(errorOf("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n" + huge + " 0 1 2\n"), "truncated"));
  std::string list =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\nproperty uchar y\nproperty uchar z\n"
      "element face 1\nproperty list uint uchar vertex_indices\nend_header\n";
  list += std::string(3, '\0') + "\xff\xff\xff\xff";
  EXPECT_TRUE(contains(errorOf("a.ply", list), "truncated: the file ends in face 0 of 1"));
}

std::string smallGlb() {
  std::string text =
      R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":42}],"bufferViews":[{"buffer":0,"byteLength":36},)"
      R"({"buffer":0,"byteOffset":36,"byteLength":6}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,)"
      R"("type":"VEC3"},{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],"meshes":[{"primitives":)"
      R"([{"attributes":{"POSITION":0},"indices":1}]}],"nodes":[{"mesh":0,"children":[1]},{"scale":[1,2,3]}],)"
      R"("scenes":[{"nodes":[0]}],"scene":0})";
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::string b = "glTF";
  put(b, std::uint32_t{2});
  put(b, static_cast<std::uint32_t>(12 + 8 + text.size() + 8 + 44));
  put(b, static_cast<std::uint32_t>(text.size()));
  b += "JSON" + text;
  put(b, std::uint32_t{44});
  b += std::string("BIN\0", 4);
  for (const float x : {0, 0, 0, 1, 0, 0, 0, 1, 0}) put(b, x);
  for (const int i : {0, 1, 2, 0}) put(b, static_cast<std::uint16_t>(i));
  return b;
}

/// Small files of each format that can be cut: text and binary PLY with colours, binary STL, GLB.
std::vector<std::pair<std::string, std::string>> smallFiles() {
  std::vector<std::pair<std::string, std::string>> files;
  files.emplace_back("cut.ply", asciiPly(kThree, 3, "3 0 1 2", 1));
  for (const bool big : {false, true}) {
    std::string b =
        std::string("ply\nformat ") + (big ? "binary_big_endian" : "binary_little_endian") +
        " 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
        "property uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\n"
        "element extra 2\nproperty list uchar uchar list\nend_header\n";
    for (int v = 0; v < 3; ++v) {
      for (const float x : {v == 1 ? 1.0F : 0.0F, v == 2 ? 1.0F : 0.0F, 0.0F}) put(b, x, big);
      b += "abc";
    }
    put(b, std::uint8_t{3});
    for (const int i : {0, 1, 2}) put(b, i, big);
    b += std::string("\x02xy\x01z", 5);
    files.emplace_back("cut.ply", b);
  }
  std::string stl(80, ' ');
  put(stl, std::uint32_t{1});
  for (const float x : {0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0}) put(stl, x);
  put(stl, std::uint16_t{0});
  files.emplace_back("cut.stl", stl);
  files.emplace_back("cut.glb", smallGlb());
  return files;
}

TEST(BadInput, filesCutAtEveryLengthAreErrors) {
  for (const auto& [name, whole] : smallFiles()) {
    ASSERT_TRUE(read(name, whole)) << read(name, whole).error().message;
    for (std::size_t length = 0; length < whole.size(); ++length) {
      auto result = read(name, whole.substr(0, length));
      ASSERT_FALSE(result) << name << " cut at " << length << " of " << whole.size();
    }
  }
}

TEST(BadInput, filesWithAnyByteChangedNeverCrash) {
  auto files = smallFiles();
  files.emplace_back("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0 1 0 1\nvn 0 0 1\nf 1//1 -2//1 3//1\n");
  files.emplace_back("a.off", "COFF\n3 1 0\n0 0 0 1 0 0\n1 0 0 0 1 0\n0 1 0 0 0 1\n3 0 1 2\n");
  files.emplace_back(
      "a.stl", "solid\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n");
  for (const auto& [name, whole] : files)
    for (std::size_t at = 0; at < whole.size(); ++at)
      for (const char value : {'\0', '\1', '\xff', '9', '-', '\n'}) {
        std::string broken = whole;
        broken[at] = value;
        auto result = read(name, broken);
        const std::string message = result ? "" : result.error().message;
        EXPECT_EQ(message.find('\n'), std::string::npos);
      }
}

}  // namespace
