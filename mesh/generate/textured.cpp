#include "mesh/generate/textured.h"

#include <turbojpeg.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <span>

#include "base/file.h"
#include "base/image.h"
#include "base/parallel.h"
#include "mesh/generate/atlas.h"

namespace mesh::generate {
namespace {

constexpr int kJpegQuality = 92;                   // a usual one of cameras
constexpr std::uint64_t kBlockVertices = 1 << 14;  // lines of a block, about
constexpr double kMaxOrigin = 1e12;                // metres; with five decimals still within 63 bits
constexpr double kTexelCost = 0.4;                 // time for a texel over that for a triangle's text, measured

std::unique_ptr<TexturedSurface> makeSurface(const TexturedOptions& options) {
  switch (options.shape) {
    case TexturedShape::kFacade:
      return makeFacade(options.triangles, options.seed);
    case TexturedShape::kTerrain:
      return makeTerrain(options.triangles, options.seed);
    case TexturedShape::kRooms:
      break;
  }
  return makeRooms(options.triangles, options.seed);
}

base::Error invalid(const std::string& message) {
  return {base::ErrorCode::kInvalidInput, message};
}

base::Result<void> check(const TexturedOptions& options, const std::string& path) {
  const std::filesystem::path file(path);
  if (file.extension() != ".obj") return invalid(path + ": a mesh with textures is written as OBJ; name it NAME.obj");
  if (file.stem().string().find_first_of(" \t") != std::string::npos)
    return invalid(path + ": an OBJ cannot name materials with spaces; choose a name without them");
  const std::uint64_t least = leastTriangles(options.shape);
  if (options.triangles < least || options.triangles > kMaxTexturedTriangles)
    return invalid(std::to_string(options.triangles) + " triangles: such a mesh with textures has between " +
                   std::to_string(least) + " and 100000000");
  if (options.texels < 1 || options.texels > kMaxTexels)
    return invalid(std::to_string(options.texels) + " texels: a triangle has between 1 and 100000 of them");
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(options.origin[axis]) <= kMaxOrigin)) return invalid("an origin farther than 1e12 from 0");
  return {};
}

std::vector<std::string> fileNames(const std::string& path, std::size_t pictures) {
  const std::string base = path.substr(0, path.size() - 4);
  std::vector<std::string> names{base + ".obj", base + ".mtl"};
  for (std::size_t i = 0; i < pictures; ++i) names.push_back(base + "_" + std::to_string(i) + ".jpg");
  return names;
}

// ---- Pictures ----

base::Result<base::Bytes> encoded(const base::Image& image) {
  struct Close {
    void operator()(void* handle) const { tjDestroy(handle); }
  };
  const std::unique_ptr<void, Close> handle(tjInitCompress());
  unsigned char* jpeg = nullptr;
  unsigned long size = 0;
  const bool done = handle && tjCompress2(handle.get(), image.pixels.data(), image.width, 0, image.height, TJPF_RGB,
                                          &jpeg, &size, TJSAMP_420, kJpegQuality, TJFLAG_ACCURATEDCT) == 0;
  base::Bytes bytes;
  if (done) bytes.assign(jpeg, jpeg + size);
  tjFree(jpeg);
  if (!done) return base::Error{base::ErrorCode::kNoSpace, "a picture cannot be encoded as JPEG"};
  return bytes;
}

// Charts are painted with a padding, and the rest of the picture is black.
base::Image painted(const TexturedSurface& surface, const Atlas& atlas, std::uint32_t picture) {
  base::Image image(atlas.pictures[picture].x, atlas.pictures[picture].y, 3);
  const double texel = 1.0 / atlas.density;
  for (const Chart& chart : atlas.charts) {
    if (chart.picture != picture) continue;
    const glm::ivec2 extent = atlas.extent(chart);
    base::parallelFor(static_cast<std::size_t>(extent.y), 0, [&](std::size_t row) {
      const int y = chart.place.y + static_cast<int>(row);
      for (int x = chart.place.x; x < chart.place.x + extent.x; ++x) {
        const glm::dvec2 st = atlas.sheetFromPicture(chart, glm::dvec2(x, y) + 0.5);
        if (!surface.covers(chart.sheet, st, atlas.style.padding * texel)) continue;
        const glm::dvec3 color = surface.color(chart.sheet, st, texel);
        for (int k = 0; k < 3; ++k)
          image.at(x, y)[k] = static_cast<std::uint8_t>(std::clamp(color[k] + 0.5, 0.0, 255.0));
      }
    });
  }
  return image;
}

// ---- The mesh ----

// Writes a number with a fixed count of decimals, the same on any machine.
void appendFixed(std::string& text, double value, int decimals) {
  std::int64_t scale = 1;
  for (int i = 0; i < decimals; ++i) scale *= 10;
  const double scaled = std::abs(value) * static_cast<double>(scale);
  const auto number = static_cast<std::int64_t>(scaled + 0.5);
  if (value < 0.0 && number > 0) text += '-';
  text += std::to_string(number / scale);
  const std::string fraction = std::to_string(number % scale);
  text += '.';
  text.append(static_cast<std::size_t>(decimals) - fraction.size(), '0');
  text += fraction;
}

class MeshText {
 public:
  MeshText(const TexturedOptions& options, const TexturedSurface& surface, const Atlas& atlas, std::string name)
      : options_(options), surface_(surface), atlas_(atlas), name_(std::move(name)) {
    for (std::uint64_t first = 0; first < surface.vertexCount(); first += kBlockVertices)
      blocks_.push_back({Block::kVertices, 0, first, std::min(first + kBlockVertices, surface.vertexCount())});
    addCharts(Block::kUv, 1);
    addCharts(Block::kFaces, 0);
  }

  std::size_t blockCount() const { return blocks_.size(); }
  std::string header() const {
    return "# generated by lumigrid sample, seed " + std::to_string(options_.seed) + "\nmtllib " + name_ + ".mtl\n";
  }
  std::string materials() const {
    std::string text;
    for (std::size_t i = 0; i < atlas_.pictures.size(); ++i) {
      const std::string material = name_ + "_" + std::to_string(i);
      text += "newmtl " + material + "\nKa 0 0 0\nKd 1 1 1\nmap_Kd " + material + ".jpg\n\n";
    }
    return text;
  }
  std::string block(std::size_t number) const {
    const Block& block = blocks_[number];
    std::string text;
    if (block.kind == Block::kVertices) {
      for (std::uint64_t v = block.first; v < block.end; ++v) appendVertex(text, v);
      return text;
    }
    const Chart& chart = atlas_.charts[block.chart];
    const bool begins =
        block.first == 0 && (block.chart == 0 || atlas_.charts[block.chart - 1].picture != chart.picture);
    if (block.kind == Block::kFaces && begins) text += "usemtl " + name_ + "_" + std::to_string(chart.picture) + "\n";
    for (std::uint64_t row = block.first; row < block.end; ++row) {
      const auto j = static_cast<std::uint32_t>(row);
      block.kind == Block::kUv ? appendUv(text, chart, j) : appendFaces(text, chart, j);
    }
    return text;
  }

 private:
  /// Some vertices, or some rows of a chart.
  struct Block {
    enum Kind { kVertices, kUv, kFaces } kind;
    std::size_t chart;
    std::uint64_t first, end;
  };

  void addCharts(Block::Kind kind, std::uint64_t more_rows) {
    for (std::size_t i = 0; i < atlas_.charts.size(); ++i) {
      const std::uint64_t rows = atlas_.charts[i].rows() + more_rows;
      const std::uint64_t step = kBlockVertices / (atlas_.charts[i].columns() + 1) + 1;
      for (std::uint64_t row = 0; row < rows; row += step)
        blocks_.push_back({kind, i, row, std::min(row + step, rows)});
    }
  }

  void appendVertex(std::string& text, std::uint64_t vertex) const {
    const glm::dvec3 p = options_.origin + surface_.position(vertex);
    text += 'v';
    for (int axis = 0; axis < 3; ++axis) {
      text += ' ';
      appendFixed(text, p[axis], 5);
    }
    text += '\n';
  }

  void appendUv(std::string& text, const Chart& chart, std::uint32_t row) const {
    const Sheet& sheet = surface_.sheets()[chart.sheet];
    const glm::dvec2 size(atlas_.pictures[chart.picture]);
    for (std::uint32_t i = chart.left; i <= chart.right; ++i) {
      const glm::dvec2 at = atlas_.pictureFromSheet(chart, {sheet.s[i], sheet.t[chart.bottom + row]}) / size;
      text += "vt ";
      appendFixed(text, at.x, 7);
      text += ' ';
      appendFixed(text, 1.0 - at.y, 7);
      text += '\n';
    }
  }

  void appendFaces(std::string& text, const Chart& chart, std::uint32_t row) const {
    const std::uint32_t j = chart.bottom + row;
    const auto corner = [&](std::uint32_t i, std::uint32_t up) {
      const std::uint64_t uv = chart.first_uv + std::uint64_t{row + up} * (chart.columns() + 1) + (i - chart.left);
      return " " + std::to_string(surface_.vertexAt(chart.sheet, i, j + up) + 1) + "/" + std::to_string(uv + 1);
    };
    for (std::uint32_t i = chart.left; i < chart.right; ++i) {
      if (!surface_.hasQuad(chart.sheet, i, j)) continue;
      const std::string low = corner(i, 0), high = corner(i + 1, 1);
      text += "f" + low + corner(i + 1, 0) + high + "\nf" + low + high + corner(i, 1) + "\n";
    }
  }

  const TexturedOptions& options_;
  const TexturedSurface& surface_;
  const Atlas& atlas_;
  std::string name_;
  std::vector<Block> blocks_;
};

base::ByteView bytesOf(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

using Progress = std::function<bool(double)>;

base::Result<void> goOn(const Progress& progress, double done) {
  if (progress && !progress(done)) return base::Error{base::ErrorCode::kCancelled, "stopped on request"};
  return {};
}

base::Result<void> writePictures(const TexturedSurface& surface, const Atlas& atlas, std::span<base::AtomicFile> files,
                                 double share, const Progress& progress) {
  for (std::uint32_t i = 0; i < files.size(); ++i) {
    LUMIGRID_TRY(goOn(progress, share * i / static_cast<double>(files.size())));
    LUMIGRID_ASSIGN_OR_RETURN(const auto jpeg, encoded(painted(surface, atlas, i)));
    LUMIGRID_TRY(files[i].write(jpeg));
  }
  return {};
}

// Blocks are made on all cores and written in order, so memory holds a few of them.
base::Result<void> writeMesh(const MeshText& mesh, base::AtomicFile& file, double share, const Progress& progress) {
  const std::size_t slots = std::size_t{4} * base::coreCount();
  std::vector<std::string> texts(slots);
  LUMIGRID_TRY(file.write(bytesOf(mesh.header())));
  return base::parallelInOrder(
      mesh.blockCount(), 0, slots,
      [&](std::size_t i, std::size_t slot) -> base::Result<void> {
        texts[slot] = mesh.block(i);
        return {};
      },
      [&](std::size_t i, std::size_t slot) -> base::Result<void> {
        LUMIGRID_TRY(file.write(bytesOf(texts[slot])));
        return goOn(progress,
                    1.0 - share * (1.0 - static_cast<double>(i + 1) / static_cast<double>(mesh.blockCount())));
      });
}

}  // namespace

base::Result<std::vector<std::string>> texturedFiles(const TexturedOptions& options, const std::string& path) {
  LUMIGRID_TRY(check(options, path));
  LUMIGRID_ASSIGN_OR_RETURN(const Atlas atlas, makeAtlas(*makeSurface(options), options.texels));
  return fileNames(path, atlas.pictures.size());
}

base::Result<void> writeTexturedObj(const TexturedOptions& options, const std::string& path, const Progress& progress) {
  LUMIGRID_TRY(check(options, path));
  const auto surface = makeSurface(options);
  LUMIGRID_ASSIGN_OR_RETURN(const Atlas atlas, makeAtlas(*surface, options.texels));
  std::vector<base::AtomicFile> files;
  for (const std::string& name : fileNames(path, atlas.pictures.size())) {
    LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(name));
    files.push_back(std::move(file));
  }
  const MeshText mesh(options, *surface, atlas, std::filesystem::path(path).stem().string());
  const double pictures = kTexelCost * static_cast<double>(options.texels);
  const double share = pictures / (1.0 + pictures);
  LUMIGRID_TRY(writePictures(*surface, atlas, std::span(files).subspan(2), share, progress));
  LUMIGRID_TRY(files[1].write(bytesOf(mesh.materials())));
  LUMIGRID_TRY(writeMesh(mesh, files[0], 1.0 - share, progress));

  // The mesh appears last, when all that it names is there.
  for (std::size_t i = files.size(); i-- > 0;) LUMIGRID_TRY(files[i].commit());
  return {};
}

}  // namespace mesh::generate
