#include "lod/ingest/staged_build.h"

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>

#include "base/fields.h"
#include "base/format_text.h"
#include "base/memory.h"
#include "base/text.h"
#include "lod/ingest/shared_source.h"
#include "mesh/sink_thread.h"
#include "mesh/stream_mesh.h"
#include "mesh/texture.h"

namespace lod::ingest {
namespace {

using base::Error;
using base::ErrorCode;

// The squares of lattice steps must stay above float32's smallest number, 1e-38.
constexpr double kMinSize = 1e-15;

// The centre of the box, rounded to a power of two of about an eighth of its longest side, so that the number is short
// and the subtraction exact; 0 for models that lie around 0 anyway.
glm::dvec3 originFor(const glm::dvec3& low, const glm::dvec3& high) {
  const glm::dvec3 size = high - low;
  const double longest = std::max({size.x, size.y, size.z});
  const glm::dvec3 reach = glm::max(glm::abs(low), glm::abs(high));
  if (std::max({reach.x, reach.y, reach.z}) <= longest) return glm::dvec3(0.0);
  const double step = longest > 0.0 ? std::exp2(std::floor(std::log2(longest)) - 2.0) : 1.0;
  return glm::round(0.5 * (low + high) / step) * step + 0.0;
}

auto fieldsOf(auto& s) {
  return std::tie(s.vertex_bytes, s.triangle_bytes, s.origin, s.info.vertices, s.info.triangles, s.info.referenced,
                  s.info.has_normals, s.info.has_colors, s.info.is_painted, s.info.box_min, s.info.box_max,
                  s.info.far_place, s.info.mean_edge, s.info.short_edge, s.info.coincident, s.info.lost,
                  s.info.short_faces, s.info.texels);
}

// Tells whether a file is the one that it was: its length and time. The keys of work directories hold the hashes of the
// files that a command names, but not of the pictures that these name.
std::pair<std::uint64_t, std::int64_t> stampOf(const std::string& path) {
  std::error_code size_error, time_error;
  const std::uint64_t size = std::filesystem::file_size(path, size_error);
  const auto time = std::filesystem::last_write_time(path, time_error);
  return {size_error ? 0 : size, time_error ? 0 : time.time_since_epoch().count()};
}

base::Bytes stateOf(const ImportedSource& source) {
  base::ByteWriter out;
  base::writeFields(out, fieldsOf(source));
  for (const auto* warnings : {&source.info.warnings, &source.info.texture_warnings}) {
    out.u32(static_cast<std::uint32_t>(warnings->size()));
    for (const std::string& warning : *warnings) out.string16(warning);
  }
  out.u32(static_cast<std::uint32_t>(source.info.pictures.size()));
  for (const mesh::SourcePicture& picture : source.info.pictures) {
    out.string16(picture.path);
    base::writeFields(out, std::tie(picture.offset, picture.bytes));
    out.u8(static_cast<std::uint8_t>((picture.base64 ? 1 : 0) | (picture.opaque ? 2 : 0)));
    const auto [size, time] = stampOf(picture.path);
    base::writeFields(out, std::tie(size, time));
  }
  const mesh::Georeference& georeference = source.info.georeference;
  out.string16(georeference.crs);
  out.string16(georeference.units);
  out.string16(georeference.moved);
  out.u8(static_cast<std::uint8_t>(georeference.up));
  return out.takeBytes();
}

base::Result<ImportedSource> readState(const WorkDirectory& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto state, directory.readStageState(Stage::kSpooled));
  base::ByteReader in(state);
  ImportedSource source;
  base::readFields(in, fieldsOf(source));
  for (auto* warnings : {&source.info.warnings, &source.info.texture_warnings})
    for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) warnings->push_back(in.string16());
  for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) {
    mesh::SourcePicture picture;
    picture.path = in.string16();
    base::readFields(in, std::tie(picture.offset, picture.bytes));
    const std::uint8_t flags = in.u8();
    picture.base64 = (flags & 1) != 0;
    picture.opaque = (flags & 2) != 0;
    std::pair<std::uint64_t, std::int64_t> stamp;
    base::readFields(in, std::tie(stamp.first, stamp.second));
    if (stamp != stampOf(picture.path)) return directory.damaged();  // and so all is read again
    source.info.pictures.push_back(std::move(picture));
  }
  mesh::Georeference& georeference = source.info.georeference;
  georeference.crs = in.string16();
  georeference.units = in.string16();
  georeference.moved = in.string16();
  georeference.up = static_cast<mesh::Georeference::Up>(in.u8());
  if (!in.atEnd() || georeference.up > mesh::Georeference::Up::kY) return directory.damaged();
  return source;
}

// The georeference that all files have in common. A file that names no system is taken to lie in the others'.
mesh::Georeference agreedOn(const std::vector<mesh::Georeference>& files, std::vector<std::string>& warnings) {
  mesh::Georeference agreed = files.front();
  std::set<std::string> systems;
  for (const mesh::Georeference& file : files) {
    if (!file.crs.empty()) systems.insert(file.crs);
    if (file.units != agreed.units) agreed.units.clear();
    if (file.up != agreed.up) agreed.up = mesh::Georeference::Up::kUnknown;
    if (file.moved != agreed.moved) agreed.moved = "moved by what the export says of each mesh";
  }
  agreed.crs = systems.size() == 1 ? *systems.begin() : "";
  if (systems.size() > 1)
    warnings.push_back("the files are in different coordinate reference systems (" + *systems.begin() + " and " +
                       *systems.rbegin() + "), so that they do not fit together; bring them into one first");
  return agreed;
}

base::Result<mesh::StreamedFile> readFile(const std::string& path, SourceSpool& spool, unsigned threads,
                                          const mesh::StreamOptions& options) {
  if (threads == 1) return mesh::streamMesh(path, spool, options);
  mesh::SinkThread thread(spool);
  auto file = mesh::streamMesh(path, thread, options);
  // The spool's error comes first, since it concerns blocks that the reader passed on before its own error.
  LUMIGRID_TRY(thread.finish());
  return file;
}

// Work files, the output, the lock, and what the library opens meanwhile: a choice, with room to spare.
constexpr std::uint64_t kDescriptors = 32;

// kNoSpace when less than kMinMemory is given.
base::Result<void> needMemory(std::uint64_t bytes) {
  if (bytes >= kMinMemory) return {};
  return Error{ErrorCode::kNoSpace, "the memory given, " + base::formatBytes(bytes) +
                                        ", is too small: building needs " + base::formatBytes(kMinMemory) +
                                        " at least (--memory)"};
}

// kNoSpace when this process may not have so many files open.
base::Result<void> needDescriptors() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= kDescriptors) return {};
  return Error{ErrorCode::kNoSpace, "this process may have " + std::to_string(limit.rlim_cur) +
                                        " files open, building needs " + std::to_string(kDescriptors) +
                                        "; raise the limit (ulimit -n) and build again"};
}

// Clouds have true copies where exports were joined, mostly of each point once, and others in one place by the file's
// own rounding.
constexpr double kToldPoints = 0.55;

constexpr double kLeastStepsPerEdge = 8.0;  // a choice: with fewer, normals are off by some ten degrees

std::string textOf(const glm::dvec3& place) {
  return base::formatText("(%.7g, %.7g, %.7g)", place.x, place.y, place.z);
}

// Whether a rerun can succeed: an error in the source stays.
bool canResume(const base::Error& error) {
  return error.code == ErrorCode::kCancelled || error.code == ErrorCode::kNoSpace || error.code == ErrorCode::kIo;
}

}  // namespace

base::Result<SourceInput> sourceFromFiles(const std::vector<std::string>& paths, const Progress& progress,
                                          unsigned threads, bool points) {
  if (paths.empty()) return Error{ErrorCode::kInvalidInput, "no mesh file is named"};
  SourceInput input;
  input.points = points;
  for (const std::string& path : paths) {
    std::error_code ignored;
    const auto size = std::filesystem::file_size(path, ignored);
    if (!ignored) input.bytes += size;
  }
  input.read = [paths, progress, threads, points](SourceSpool& spool, SourceInfo& notes) -> base::Result<void> {
    std::vector<bool> colored;
    std::vector<mesh::Georeference> georeferences;
    for (std::size_t i = 0; i < paths.size(); ++i) {
      mesh::StreamOptions stream;
      stream.accepts_points = points;
      stream.progress = [&](double done) {
        return !progress || progress("import", (static_cast<double>(i) + done) / static_cast<double>(paths.size()));
      };
      stream.keep_units = [&spool](const mesh::SourcePicture& picture, base::ByteView units) {
        spool.keepUnits(picture, units);
      };
      spool.beginFile(paths[i]);
      LUMIGRID_ASSIGN_OR_RETURN(auto file, readFile(paths[i], spool, threads, stream));
      for (const std::string& warning : file.warnings) notes.warnings.push_back(paths[i] + ": " + warning);
      notes.short_faces += file.short_faces;
      notes.texels += file.texels;
      spool.addPictures(file.pictures);
      if (const std::string lost = mesh::lostTexels(file.texels, file.vertices); !lost.empty())
        notes.texture_warnings.push_back(paths[i] + ": " + lost);
      colored.push_back(file.has_colors);
      georeferences.push_back(file.georeference);
    }
    notes.georeference = agreedOn(georeferences, notes.warnings);
    for (std::size_t i = 0; i < paths.size(); ++i)
      if (!colored[i] && std::find(colored.begin(), colored.end(), true) != colored.end())
        notes.warnings.push_back(paths[i] + ": has no colours while other files have; it becomes white");
    return {};
  };
  return input;
}

base::Result<ImportedSource> importSource(WorkDirectory& directory, const SourceInput& input, unsigned threads) {
  if (directory.isFinished(Stage::kSpooled)) return readState(directory);
  LUMIGRID_TRY(directory.needSpace(input.bytes, "the source's vertices and triangles"));
  LUMIGRID_ASSIGN_OR_RETURN(auto spool, SourceSpool::create(directory.path()));
  SourceInfo notes;
  LUMIGRID_TRY(input.read(spool, notes));
  ImportedSource source;
  LUMIGRID_ASSIGN_OR_RETURN(source.info, spool.finish(input.points, threads));
  source.info.georeference = std::move(notes.georeference);
  source.info.warnings = std::move(notes.warnings);
  source.info.texture_warnings = std::move(notes.texture_warnings);
  source.info.short_faces = notes.short_faces;
  source.info.texels = notes.texels;
  const glm::dvec3 size = source.info.box_max - source.info.box_min;
  const double longest = std::max({size.x, size.y, size.z});
  if (longest > 0.0 && longest < kMinSize)
    return Error{ErrorCode::kInvalidInput,
                 "the mesh is less than 1e-15 units across, too small for what is computed from it; scale it up"};
  source.origin = originFor(source.info.box_min, source.info.box_max);
  source.vertex_bytes = spool.vertexBytes();
  source.triangle_bytes = spool.triangleBytes();
  LUMIGRID_TRY(directory.finishStage(Stage::kSpooled, stateOf(source), {"vertices", "triangles"}));
  return source;
}

base::Result<SourceSpool> openSource(const WorkDirectory& directory, const ImportedSource& source) {
  LUMIGRID_ASSIGN_OR_RETURN(auto spool, SourceSpool::open(directory.path()));
  if (source.vertex_bytes != spool.vertexBytes() || source.triangle_bytes != spool.triangleBytes())
    return directory.damaged();
  return spool;
}

base::Result<Buckets> sortSpool(WorkDirectory& directory, const std::function<base::Result<SourceSpool>()>& open,
                                std::function<void()> leave, const SourceInfo& info, const SourceLattice& lattice,
                                const BucketOptions& options) {
  if (directory.isFinished(Stage::kSorted)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto state, directory.readStageState(Stage::kSorted));
    return Buckets::open(directory.path(), state);
  }
  const bool textures = options.keeps_textures && !info.pictures.empty();
  const std::uint64_t record = 3 * (8U + (info.has_colors ? 4U : 0U) + (info.has_normals ? 4U : 0U)) +
                               (textures ? sizeof(TexturePlace) + sizeof(std::uint64_t) : 0U);
  LUMIGRID_TRY(directory.needSpace(info.triangles * record, "the triangles sorted by voxels"));
  LUMIGRID_ASSIGN_OR_RETURN(auto spool, open());
  LUMIGRID_ASSIGN_OR_RETURN(auto buckets, Buckets::sort(spool, info, lattice, directory.path(), options));
  std::vector<std::string> files{"buckets"};
  if (textures) files.emplace_back(TexturePlaces::kName);
  LUMIGRID_TRY(directory.finishStage(Stage::kSorted, buckets.encodeTables(), files, std::move(leave)));
  base::releaseFreedMemory(2 * options.limits.memory_bytes);
  return buckets;
}

namespace {

/// How far apart 32-bit floats are at the farthest coordinate of the source; 0 where its coordinates are no floats.
double floatStepOf(const SourceInfo& info) {
  double farthest = 0.0;
  for (const glm::dvec3& corner : {info.box_min, info.box_max})
    for (int axis = 0; axis < 3; ++axis) {
      if (static_cast<double>(static_cast<float>(corner[axis])) != corner[axis]) return 0.0;
      farthest = std::max(farthest, std::abs(corner[axis]));
    }
  const auto at = static_cast<float>(farthest);
  return static_cast<double>(std::nextafter(at, std::numeric_limits<float>::infinity()) - at);
}

/// Says so where the file's own numbers are too coarse for its triangles.
void warnOfFloats(const SourceInfo& info, std::uint64_t collapsed, std::vector<std::string>& warnings) {
  const double step = floatStepOf(info);
  if (collapsed < info.triangles / 1000 + 1 || !(step > 0.1 * info.mean_edge)) return;
  warnings.push_back(base::formatCount(collapsed) + " triangles have no area, since the file's 32-bit floats are " +
                     base::formatText("%.3g", step) +
                     " apart at its coordinates and edges are about as long; export it with doubles, or with "
                     "coordinates relative to a place nearby");
}

}  // namespace

std::string lostTriangles(const SourceInfo& info, const SourceLattice& lattice, std::uint64_t collapsed) {
  const auto all = static_cast<double>(info.triangles);
  if (!(static_cast<double>(collapsed) > kToldShare * all)) return {};
  // Vertices in one place are the source's own.
  if (static_cast<double>(collapsed) - info.coincident * all <= kToldShare * all) return {};
  const std::string step = base::formatText("%.3g", lattice.lattice.step);
  const std::string lost =
      base::formatCount(collapsed) + " of " + base::formatCount(info.triangles) + " triangles are ";
  if (lattice.bits < kMaxLatticeBits && finerKeepsMost(info, lattice.bits))
    return lost + "smaller than the lattice's step of " + step + " and are left out; raise --position-bits (" +
           std::to_string(lattice.bits) + " now, 21 at most)";
  // Bits are short where the box is large, not where the source has slivers.
  if (kLeastStepsPerEdge * makeLattice(info, glm::dvec3(0.0), kMaxLatticeBits).lattice.step > info.mean_edge)
    return lost + "smaller than the lattice's step of " + step + " and are left out; what lies at " +
           textOf(info.far_place) + " makes the mesh's box so large: remove it, or make it a scene of its own";
  return lost + "slivers, whose shortest edge is below the lattice's step of " + step +
         ", and are left out, which moves no place farther than " +
         base::formatText("%.3g", lattice.lattice.positionError()) + "; no --position-bits keep most of them";
}

std::string roundedShapes(const SourceInfo& info, const SourceLattice& lattice) {
  const double step = lattice.lattice.step;
  if (lattice.bits < kMaxLatticeBits || !(kLeastStepsPerEdge * step > info.mean_edge) || info.triangles == 0) return {};
  return "places are rounded to " + base::formatText("%.3g", step) + ", where edges are about " +
         base::formatText("%.3g", info.mean_edge) +
         " long, so that shapes show steps; the mesh's box is that large, as far as " + textOf(info.far_place) +
         ": remove what lies there if it strayed, or build parts of the mesh as scenes of their own";
}

std::string lostPoints(const SourceInfo& info, const SourceLattice& lattice, std::uint64_t merged) {
  if (info.triangles > 0 || !(static_cast<double>(merged) > kToldPoints * static_cast<double>(info.vertices)))
    return {};
  return base::formatCount(merged) + " of " + base::formatCount(info.vertices) +
         " points became one with another within " + base::formatText("%.3g", lattice.lattice.step) +
         "; if they are no copies, what lies at " + textOf(info.far_place) +
         " makes the cloud's box so large: remove it, or make it a scene of its own";
}

void addRepairs(const ImportedSource& source, const Buckets& buckets, const SourceLattice& lattice,
                SourceSummary& summary) {
  RepairCounts& repairs = summary.repairs;
  repairs.add("degenerate_triangles", source.info.short_faces + buckets.totals().degenerate);
  repairs.add("lattice_collapsed_triangles", buckets.totals().collapsed);
  repairs.add("two_sided_triangles", buckets.totals().two_sided);
  repairs.add("flipped_triangles", buckets.winding().flipped());
  repairs.add("non_orientable_parts", buckets.winding().nonOrientable());
  repairs.add("unreferenced_vertices", source.info.vertices - source.info.referenced);
  const StitchCounts& stitched = buckets.totals().stitched;
  repairs.add("stitched_vertices", stitched.stitched_vertices);
  repairs.add("split_border_edges", stitched.split_edges);
  repairs.add("closed_holes", stitched.closed_holes);
  repairs.add("added_triangles", buckets.totals().added);
  summary.border.open_edges = buckets.winding().openEdges();
  summary.border.source_open_edges = std::max(stitched.source_edges, summary.border.open_edges);
  summary.border.largest_movement = stitched.largest_movement * lattice.lattice.step;
  std::string coarse = lostTriangles(source.info, lattice, buckets.totals().collapsed);
  if (coarse.empty()) coarse = roundedShapes(source.info, lattice);
  if (!coarse.empty())
    summary.warnings.push_back(std::move(coarse));
  else
    warnOfFloats(source.info, buckets.totals().collapsed + buckets.totals().degenerate, summary.warnings);
  if (stitched.too_many != 0)
    summary.warnings.push_back(
        "the source's border edges lie too close together to be stitched in this memory; for fewer gaps raise "
        "--memory");
}

ResumeKey withPrefix(std::string prefix, ResumeKey key) {
  if (!key) return {};
  return [prefix = std::move(prefix), key = std::move(key)]() -> base::Result<std::string> {
    auto text = key();
    return text ? prefix + *text : std::move(text);
  };
}

base::Error namingSource(const std::vector<std::string>& paths, base::Error error) {
  const bool of_mesh = error.message.rfind("the mesh", 0) == 0 || error.message.rfind("no triangle", 0) == 0;
  return of_mesh && !paths.empty() ? base::within(paths.front(), std::move(error)) : error;
}

base::Result<void> StagedBuild::run(const std::string& key_prefix, const std::function<base::Result<void>()>& stages) {
  LUMIGRID_TRY(needMemory(limits_.memory_bytes));
  LUMIGRID_TRY(needDescriptors());
  const ResumeKey key = withPrefix(kImportFormat + key_prefix, options_.resume_key);
  const std::string& path = options_.work_directory;
  LUMIGRID_ASSIGN_OR_RETURN(directory_, WorkDirectory::open(path.empty() ? output_path_ + ".work" : path, key));
  base::removeUnfinished(output_path_);  // the lock makes sure that no other build is writing it
  auto done = stages();
  if (done && options_.on_written) options_.on_written();
  // A complete output needs no work files, whole or damaged.
  if (done) directory_->abandonStages();
  (void)directory_->settle();
  if (done || !key || !canResume(done.error())) directory_->remove();
  if (!done && !canResume(done.error()) && options_.shared != nullptr) options_.shared->remove();
  return done;
}

base::Result<void> StagedBuild::importSource(const SourceInput& input, std::uint32_t position_bits) {
  LUMIGRID_TRY(checkPositionBits(position_bits));
  if (!directory_->isFinished(Stage::kSpooled) && !report("import", 0.0)) return cancelled();
  if (options_.shared != nullptr) {
    LUMIGRID_ASSIGN_OR_RETURN(source_, options_.shared->importSource(input, limits_.threads));
    shares_source_ = SharedSource::serves(input, source_);
  }
  // The directory's own stages begin behind those of the source.
  if (!shares_source_) {
    LUMIGRID_ASSIGN_OR_RETURN(source_, ingest::importSource(*directory_, input, limits_.threads));
  } else if (!directory_->isFinished(Stage::kSpooled)) {
    LUMIGRID_TRY(directory_->finishStage(Stage::kSpooled, {}, {}));
  }
  // Points of a cloud are closer together than the ends of a mesh's edges, and no edge tells how close.
  const bool points = source_.info.triangles == 0;
  lattice_ = makeLattice(source_.info, source_.origin, points ? kMaxLatticeBits : position_bits);
  import_seconds_ = watch_.seconds();
  return {};
}

void StagedBuild::reportPlan(std::uint64_t output_bytes, std::uint64_t work_bytes, std::uint64_t items,
                             double items_per_core_second) const {
  if (!options_.on_plan) return;
  options_.on_plan({source_.info.triangles, source_.info.referenced, output_bytes, work_bytes,
                    static_cast<double>(items) / (items_per_core_second * threads())});
}

base::Result<SourceSpool> StagedBuild::openSpool() {
  return shares_source_ ? options_.shared->openSpool(source_) : openSource(*directory_, source_);
}

std::function<void()> StagedBuild::spoolLeaver() {
  if (shares_source_) return [shared = options_.shared] { shared->leaveSpool(); };
  return [path = directory_->path()] { SourceSpool::remove(path); };
}

base::Result<Buckets> StagedBuild::sortTriangles(const SortOptions& options) {
  keeps_textures_ = options.keeps_textures;
  const bool was_sorted = directory_->isFinished(Stage::kSorted);
  if (!was_sorted && !report("sort", 0.0)) return cancelled();
  const auto progress = [this](double done) { return report("sort", done); };
  const BucketOptions sorting{{limits_.threads, workMemory() / 2}, options.stitch, progress, options.keeps_textures};
  shares_buckets_ =
      shares_source_ && options.read_until && options_.shared->sortsAs(options.stitch, options_.position_bits);
  if (!shares_buckets_) {
    const auto open = [this] { return openSpool(); };
    return sortSpool(*directory_, open, spoolLeaver(), source_.info, lattice_, sorting);
  }
  const bool reads = !directory_->isFinished(*options.read_until);
  LUMIGRID_ASSIGN_OR_RETURN(auto buckets, options_.shared->sortTriangles(source_, lattice_, sorting, reads));
  if (!was_sorted) LUMIGRID_TRY(directory_->finishStage(Stage::kSorted, {}, {}));
  if (!reads) leaveBuckets(buckets);
  return buckets;
}

void StagedBuild::leaveBuckets(Buckets& buckets) {
  if (shares_buckets_)
    options_.shared->leaveBuckets(buckets);
  else
    buckets.release();
}

const std::string& StagedBuild::sourceDirectory() const {
  return shares_source_ ? options_.shared->path() : directory_->path();
}

const std::string& StagedBuild::bucketDirectory() const {
  return shares_buckets_ ? options_.shared->path() : directory_->path();
}

bool StagedBuild::report(const std::string& stage, double done) {
  const std::lock_guard lock(progress_mutex_);
  return !progress_ || progress_(stage, done);
}

void StagedBuild::summarize(SourceSummary& summary) const {
  summary.origin = source_.origin;
  summary.box_min = source_.info.box_min;
  summary.box_max = source_.info.box_max;
  summary.has_colors = source_.info.has_colors;
  summary.is_painted = source_.info.is_painted;
  summary.georeference = source_.info.georeference;
  // Those of the method's own stages are there already.
  std::vector<std::string> warnings = source_.info.warnings;
  if (!keeps_textures_)
    warnings.insert(warnings.end(), source_.info.texture_warnings.begin(), source_.info.texture_warnings.end());
  summary.warnings.insert(summary.warnings.begin(), warnings.begin(), warnings.end());
  summary.import_seconds = import_seconds_;
  summary.seconds = watch_.seconds();
  summary.cpu_seconds = watch_.cpuSeconds();
}

}  // namespace lod::ingest
