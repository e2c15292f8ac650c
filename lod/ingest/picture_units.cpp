#include "lod/ingest/picture_units.h"

#include <filesystem>

namespace lod::ingest {

base::Result<PictureUnits> PictureUnits::create(const std::string& directory) {
  PictureUnits units;
  LUMIGRID_ASSIGN_OR_RETURN(auto log, RecordLog::open(directory + "/" + kName, false, {}));
  units.log_ = std::make_unique<RecordLog>(std::move(log));
  return units;
}

base::Result<PictureUnits> PictureUnits::open(const std::string& directory) {
  PictureUnits units;
  const std::string path = directory + "/" + kName;
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return units;
  const auto note = [&](std::uint64_t offset, base::ByteView payload) {
    base::ByteReader in(payload);
    const std::uint64_t begin = in.u64(), bytes = in.u64();
    std::string picture = in.string16();
    if (!in.ok()) return false;
    units.places_[{std::move(picture), begin, bytes}] = {offset + in.offset(), payload.size() - in.offset()};
    return true;
  };
  LUMIGRID_ASSIGN_OR_RETURN(auto log, RecordLog::open(path, true, note));
  units.log_ = std::make_unique<RecordLog>(std::move(log));
  return units;
}

void PictureUnits::add(const mesh::SourcePicture& picture, base::ByteView units) {
  base::ByteWriter record;
  record.u64(picture.offset);
  record.u64(picture.bytes);
  record.string16(picture.path);
  record.bytes(units);
  const std::lock_guard lock(*mutex_);
  // A picture that is not kept in memory is read again, and its units are told again.
  if (!log_ || !places_.try_emplace({picture.path, picture.offset, picture.bytes}).second) return;
  if (!log_->add(record.view())) log_.reset();
}

base::Bytes PictureUnits::of(const mesh::SourcePicture& picture) const {
  const auto found = places_.find({picture.path, picture.offset, picture.bytes});
  if (found == places_.end()) return {};
  base::Bytes bytes(found->second.bytes);
  return log_->readAt(found->second.offset, bytes) ? bytes : base::Bytes();
}

}  // namespace lod::ingest
