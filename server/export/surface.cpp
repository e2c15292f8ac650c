#include "server/export/surface.h"

#include <limits>
#include <map>
#include <tuple>

#include "base/jpeg/jpeg.h"
#include "base/png/png.h"

namespace server::exports {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using lod::patch::PatchGeometry;

constexpr std::uint32_t kNoVertex = std::numeric_limits<std::uint32_t>::max();
constexpr double kCellSteps = 4194304.0;  // 2^22: half of it to either side leaves floats of 24 bits two to spare

class SurfaceBuilder {
 public:
  SurfaceBuilder(const ExportScene& scene, const glm::ivec3& origin, const AddPrimitive& add)
      : scene_(scene), origin_(origin), add_(add) {}

  Result<void> addPatch(std::uint32_t patch) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, scene_.patches.geometry(patch));
    std::vector<bool> on_page(geometry.indices.size() / 3, false);
    if (scene_.textures)
      for (const lod::texture::PageRecord& record : scene_.textures->pagesOf(patch))
        LUMIGRID_TRY(addPage(patch, geometry, record, on_page));
    return addRest(geometry, on_page);
  }

  Result<void> finish() {
    if (plain_.indices.empty()) return {};
    GlbPrimitive done = std::move(plain_);
    plain_ = {};
    return add_(std::move(done));
  }

 private:
  // A vertex without colour and place.
  void addVertex(const PatchGeometry& geometry, std::uint32_t v, GlbPrimitive& to) const {
    const glm::dvec3 steps(geometry.positions[v] - origin_);
    to.positions.emplace_back(scene_.hierarchy().lattice.step * steps);
    if (!scene_.unlit()) to.normals.push_back(geometry.normals[v]);
  }

  Result<void> addPage(std::uint32_t patch, const PatchGeometry& geometry, const lod::texture::PageRecord& record,
                       std::vector<bool>& on_page) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto page, scene_.textures->page(record));
    const glm::vec2 size =
        static_cast<float>(lod::texture::kCornerSteps) * glm::vec2(page.image.width, page.image.height);
    GlbPrimitive primitive;
    // A vertex becomes as many as it has places on the page.
    std::map<std::tuple<std::uint16_t, std::uint16_t, std::uint16_t>, std::uint32_t> vertices;
    for (const lod::texture::PageTriangle& t : page.triangles) {
      if (t.triangle >= on_page.size())
        return Error{ErrorCode::kInvalidInput, scene_.textures->path() + ": a page of patch " + std::to_string(patch) +
                                                   " has triangles that the patch has not; build the scene again"};
      on_page[t.triangle] = true;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint16_t v = geometry.indices[3 * t.triangle + k];
        const glm::u16vec2 corner = t.corners[k];
        const auto next = static_cast<std::uint32_t>(primitive.positions.size());
        const auto [at, is_new] = vertices.try_emplace({v, corner.x, corner.y}, next);
        if (is_new) {
          addVertex(geometry, v, primitive);
          primitive.places.push_back(glm::vec2(corner) / size);
        }
        primitive.indices.push_back(at->second);
      }
    }
    LUMIGRID_TRY(encodePicture(page.image, primitive));
    return add_(std::move(primitive));
  }

  // A JPEG has no alpha.
  Result<void> encodePicture(const base::Image& image, GlbPrimitive& to) const {
    if (image.channels == 4) {
      to.picture_is_png = to.masked = true;
      LUMIGRID_ASSIGN_OR_RETURN(const auto rows, base::beginPng(image.width, image.height, 4, to.picture));
      return rows->add(image);
    }
    LUMIGRID_ASSIGN_OR_RETURN(to.picture, base::encodeJpeg(image, scene_.jpeg_quality, base::Subsampling::k444));
    return {};
  }

  // Triangles that are on no page, in the colours of their vertices.
  Result<void> addRest(const PatchGeometry& geometry, const std::vector<bool>& on_page) {
    if (plain_.positions.size() + geometry.positions.size() > kMaxShortVertices) LUMIGRID_TRY(finish());
    std::vector<std::uint32_t> number(geometry.positions.size(), kNoVertex);
    for (std::size_t t = 0; t < on_page.size(); ++t) {
      if (on_page[t]) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint16_t v = geometry.indices[3 * t + k];
        if (number[v] == kNoVertex) {
          number[v] = static_cast<std::uint32_t>(plain_.positions.size());
          addVertex(geometry, v, plain_);
          if (!geometry.colors.empty()) {
            const glm::u8vec4 c = geometry.colors[v];
            plain_.colors.emplace_back(linearFromSrgb(c.r), linearFromSrgb(c.g), linearFromSrgb(c.b));
          }
        }
        plain_.indices.push_back(number[v]);
      }
    }
    return {};
  }

  const ExportScene& scene_;
  glm::ivec3 origin_;
  const AddPrimitive& add_;
  GlbPrimitive plain_;
};

}  // namespace

Result<ExportScene> openForExport(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(directory));
  if (!base::partFile(scene, "patch", ".lgp"))
    return Error{ErrorCode::kNotFound,
                 directory + ": has no patch hierarchy, which an export is made of; build the scene with patches"};
  LUMIGRID_ASSIGN_OR_RETURN(auto patches, lod::patch::PatchFile::open(base::patchPath(directory, scene)));
  ExportScene open{std::move(scene), std::move(patches), std::nullopt};
  if (const auto file = base::partFile(open.scene, "texture", ".lgt")) {
    LUMIGRID_ASSIGN_OR_RETURN(open.textures, lod::texture::TextureFile::open(directory + "/" + *file));
  }
  return open;
}

double metresPerUnit(const base::Scene& scene) {
  if (scene.units == "ft") return 0.3048;
  if (scene.units == "us-ft") return 1200.0 / 3937.0;
  return 1.0;
}

glm::ivec3 floatOriginNear(const lod::patch::Hierarchy& hierarchy, const glm::vec3& place) {
  const lod::Lattice& lattice = hierarchy.lattice;
  base::Aabb whole;
  const lod::patch::Group& top = hierarchy.groups[0];
  for (std::uint32_t p = top.first_patch; p < top.first_patch + top.patch_count; ++p)
    whole.add(hierarchy.patches[p].box);
  const glm::dvec3 middle = glm::round((glm::dvec3(whole.center()) - lattice.origin) / lattice.step);
  const glm::dvec3 steps = (glm::dvec3(place) - lattice.origin) / lattice.step;
  return glm::ivec3(middle + kCellSteps * glm::round((steps - middle) / kCellSteps));
}

glm::dmat4 tileFromMesh(const lod::Lattice& lattice, const glm::ivec3& origin) {
  const glm::dvec3 at = lattice.origin + lattice.step * glm::dvec3(origin);
  // (x, y, z) becomes (x, z, −y); columns are the images of the axes.
  return {{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, -1.0, 0.0}, {0.0, 1.0, 0.0, 0.0}, {at.x, at.z, -at.y, 1.0}};
}

Result<void> addSurface(const ExportScene& scene, std::span<const std::uint32_t> patches, const glm::ivec3& origin,
                        const AddPrimitive& add, const std::function<bool(std::size_t done)>& go_on) {
  SurfaceBuilder builder(scene, origin, add);
  for (std::size_t i = 0; i < patches.size(); ++i) {
    if (go_on && !go_on(i)) return Error{ErrorCode::kCancelled, "stopped"};
    LUMIGRID_TRY(builder.addPatch(patches[i]));
  }
  return builder.finish();
}

}  // namespace server::exports
