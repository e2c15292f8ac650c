#include <openssl/evp.h>

#include <array>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "repository/verify.h"
#include "server/cmd/commands.h"
#include "server/cmd/console.h"
#include "server/net/open_scene.h"

namespace server::cmd {
namespace {

struct InfoArguments {
  std::string scene;
  bool json = false;
  bool digest = false;
};

struct Level {
  std::uint64_t triangles = 0, patches = 0;
  float max_error = 0.0F;
  float max_color_error = 0.0F;  // 0 … 1
};

std::vector<Level> levelsOf(const lod::patch::Hierarchy& hierarchy) {
  std::vector<Level> levels;
  for (const lod::patch::Patch& patch : hierarchy.patches) {
    if (levels.size() <= patch.level) levels.resize(patch.level + 1);
    Level& level = levels[patch.level];
    level.triangles += patch.triangles;
    ++level.patches;
    if (patch.producer == lod::patch::kNoGroup) continue;
    const lod::patch::Group& group = hierarchy.groups[patch.producer];
    level.max_error = std::max(level.max_error, group.error);
    level.max_color_error = std::max(level.max_color_error, group.attribute_error);
  }
  return levels;
}

nlohmann::json describeHierarchy(const OpenScene& open) {
  const lod::patch::Hierarchy& h = open.patches.hierarchy();
  nlohmann::json j{{"bytes", open.patches.fileBytes()},
                   {"groups", h.groups.size()},
                   {"patches", h.patches.size()},
                   {"lattice_step", h.lattice.step},
                   {"position_error", h.lattice.positionError()},
                   {"levels", nlohmann::json::array()}};
  for (const Level& level : levelsOf(h))
    j["levels"].push_back({{"triangles", level.triangles},
                           {"patches", level.patches},
                           {"max_error", level.max_error},
                           {"max_color_error", level.max_color_error}});
  return j;
}

nlohmann::json describeImages(const OpenScene& open, const repository::Contents& contents) {
  const repository::Grid& grid = open.data.welcome.grid;
  return {{"images", contents.faces - contents.empty},
          {"empty", contents.empty},
          {"expected", grid.faceCount()},
          {"jpeg_bytes", contents.jpeg_bytes},
          {"coverage_bytes", contents.coverage_bytes},
          {"unreadable", contents.unreadable},
          {"grid", {grid.count.x, grid.count.y, grid.count.z}},
          {"spacing", grid.spacing},
          {"face_size", grid.face_size}};
}

// SHA-256 over every key (8 bytes, big-endian), length (8, little-endian) and value in the order of keys: equal exactly
// when the repositories are, value by value, however they are divided into shards.
base::Result<std::string> digestOf(const repository::Store& store) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> hash(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  bool good = hash && EVP_DigestInit_ex(hash.get(), EVP_sha256(), nullptr) == 1;
  LUMIGRID_TRY(store.forEach([&](const repository::FaceKey& key, base::ByteView value) {
    base::ByteWriter head;
    for (int shift = 56; shift >= 0; shift -= 8) head.u8(static_cast<std::uint8_t>(key.code() >> shift));
    head.u64(value.size());
    good = good && EVP_DigestUpdate(hash.get(), head.view().data(), head.view().size()) == 1 &&
           EVP_DigestUpdate(hash.get(), value.data(), value.size()) == 1;
    return good;
  }));
  std::array<unsigned char, EVP_MAX_MD_SIZE> bytes{};
  unsigned size = 0;
  if (!good || EVP_DigestFinal_ex(hash.get(), bytes.data(), &size) != 1)
    return base::Error{base::ErrorCode::kUnsupported, "SHA-256 is not available in this OpenSSL"};
  std::string text;
  for (unsigned i = 0; i < size; ++i) {
    constexpr char kHex[] = "0123456789abcdef";
    text += {kHex[bytes[i] >> 4], kHex[bytes[i] & 15]};
  }
  return text;
}

void print(const InfoArguments& a, const nlohmann::json& j) {
  const auto& s = j["scene"];
  std::printf("%s: %s triangles, colours: %s, light: %s, units: %s\n", a.scene.c_str(),
              formatCount(s["triangles"].get<std::uint64_t>()).c_str(), s["has_colors"].get<bool>() ? "yes" : "no",
              s["light"]["mode"].get<std::string>().c_str(), s["units"].get<std::string>().c_str());
  std::printf("box %s to %s\n", s["box_min"].dump().c_str(), s["box_max"].dump().c_str());
  for (const auto& source : s["sources"])
    std::printf("source %s, %s\n", source["path"].get<std::string>().c_str(),
                formatBytes(source["bytes"].get<std::uint64_t>()).c_str());
  for (const auto& [what, count] : s["repairs"].items())
    std::printf("repaired: %s %s\n", formatCount(count.get<std::uint64_t>()).c_str(), what.c_str());

  const auto& h = j["hierarchy"];
  std::printf("hierarchy: %s patches in %s groups, %s; positions within %g\n",
              formatCount(h["patches"].get<std::uint64_t>()).c_str(),
              formatCount(h["groups"].get<std::uint64_t>()).c_str(),
              formatBytes(h["bytes"].get<std::uint64_t>()).c_str(), h["position_error"].get<double>());
  int number = 0;
  for (const auto& level : h["levels"])
    std::printf("  level %2d: %12s triangles %8s patches, error up to %g\n", number++,
                formatCount(level["triangles"].get<std::uint64_t>()).c_str(),
                formatCount(level["patches"].get<std::uint64_t>()).c_str(), level["max_error"].get<double>());
  if (!j.contains("images")) {
    std::printf("images: none\n");
    return;
  }
  const auto& i = j["images"];
  const auto images = i["images"].get<std::uint64_t>();
  const auto expected = i["expected"].get<std::uint64_t>();
  std::printf("images: %s of %d x %d pixels, %s faces see nothing; grid %s, spacing %g\n", formatCount(images).c_str(),
              i["face_size"].get<int>(), i["face_size"].get<int>(),
              formatCount(i["empty"].get<std::uint64_t>()).c_str(), i["grid"].dump().c_str(),
              i["spacing"].get<double>());
  std::printf(
      "  %s JPEG, %s coverage, %s an image\n", formatBytes(i["jpeg_bytes"].get<std::uint64_t>()).c_str(),
      formatBytes(i["coverage_bytes"].get<std::uint64_t>()).c_str(),
      formatBytes(
          images == 0 ? 0 : (i["jpeg_bytes"].get<std::uint64_t>() + i["coverage_bytes"].get<std::uint64_t>()) / images)
          .c_str());
  if (i.contains("sha256")) std::printf("  SHA-256 of all values %s\n", i["sha256"].get<std::string>().c_str());
  if (images + i["empty"].get<std::uint64_t>() != expected)
    std::printf("  %s faces are missing; run the same `lumigrid build` again\n",
                formatCount(expected - images - i["empty"].get<std::uint64_t>()).c_str());
}

int run(const InfoArguments& a) {
  auto open = openScene(a.scene);
  if (!open) return fail(open.error());
  nlohmann::json j;
  j["scene"] = nlohmann::json::parse((*open)->scene_json.begin(), (*open)->scene_json.end());
  j["triangles"] = (*open)->scene.triangles;
  j["hierarchy"] = describeHierarchy(**open);
  if ((*open)->images) {
    auto contents = repository::contentsOf(*(*open)->images);
    if (!contents) return fail(contents.error());
    j["images"] = describeImages(**open, *contents);
    if (a.digest) {
      auto digest = digestOf(*(*open)->images);
      if (!digest) return fail(digest.error());
      j["images"]["sha256"] = *digest;
    }
  }
  if (a.json)
    std::printf("%s\n", j.dump(2).c_str());
  else
    print(a, j);
  return kDone;
}

}  // namespace

Run addInfo(CLI::App& command) {
  auto a = std::make_shared<InfoArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_flag("--digest", a->digest,
                   "also a SHA-256 over the keys and values of all images, the same however they are divided");
  command.add_flag("--json", a->json, "as JSON");
  return [a] { return run(*a); };
}

}  // namespace server::cmd
