#include "lod/patch/builder/work_store.h"

#include "base/fields.h"

namespace lod::patch::builder {
namespace {

base::Bytes payloadOf(const WorkUnit& unit, const std::vector<NewPatch>& patches) {
  base::ByteWriter out;
  base::writeFields(out, std::tie(unit.level, unit.index, unit.group));
  out.u32(static_cast<std::uint32_t>(patches.size()));
  for (const NewPatch& patch : patches) {
    out.write(patch.record);
    out.u32(static_cast<std::uint32_t>(patch.border.size()));
    out.u32(static_cast<std::uint32_t>(patch.encoded.size()));
    out.u32(static_cast<std::uint32_t>(patch.carried.size()));
    out.bytes(base::ByteView(reinterpret_cast<const std::uint8_t*>(patch.border.data()), 8 * patch.border.size()));
    out.bytes(patch.encoded);
    out.bytes(patch.carried);
  }
  return out.takeBytes();
}

std::size_t borderBytes(const WorkPatch& patch) {
  return sizeof(std::uint64_t) * patch.border_codes;
}

// `offset`: where the payload lies in the file. False if the bytes are not a payload.
bool readPayload(base::ByteView payload, std::uint64_t offset, WorkUnit& unit, std::vector<WorkPatch>& patches) {
  base::ByteReader in(payload);
  base::readFields(in, std::tie(unit.level, unit.index, unit.group));
  const std::uint32_t count = in.u32();
  if (!in.ok() || count > in.remaining() / sizeof(Patch)) return false;
  patches.resize(count);
  for (WorkPatch& patch : patches) {
    base::readFields(in, std::tie(patch.record, patch.border_codes, patch.encoded_bytes, patch.carried_bytes));
    patch.offset = offset + in.offset();
    (void)in.bytes(borderBytes(patch) + patch.encoded_bytes + patch.carried_bytes);
  }
  return in.atEnd();
}

}  // namespace

base::Result<WorkStore> WorkStore::open(const std::string& path, bool resume,
                                        const std::function<void(const WorkUnit&, std::vector<WorkPatch>)>& found) {
  const auto keep = [&](std::uint64_t offset, base::ByteView payload) {
    WorkUnit unit;
    std::vector<WorkPatch> patches;
    if (!readPayload(payload, offset, unit, patches)) return false;
    found(unit, std::move(patches));
    return true;
  };
  WorkStore store;
  LUMIGRID_ASSIGN_OR_RETURN(store.log_, ingest::RecordLog::open(path, resume, keep));
  return store;
}

base::Result<std::vector<WorkPatch>> WorkStore::add(const WorkUnit& unit, std::vector<NewPatch> patches) {
  const base::Bytes payload = payloadOf(unit, patches);
  LUMIGRID_ASSIGN_OR_RETURN(const auto offset, log_.add(payload));
  WorkUnit unused;
  std::vector<WorkPatch> stored;
  (void)readPayload(payload, offset, unused, stored);
  return stored;
}

base::Result<void> WorkStore::readBorder(const WorkPatch& patch, std::vector<std::uint64_t>& codes) const {
  codes.resize(patch.border_codes);
  return log_.readAt(patch.offset, {reinterpret_cast<std::uint8_t*>(codes.data()), borderBytes(patch)});
}

base::Result<base::Bytes> WorkStore::encoded(const WorkPatch& patch) const {
  base::Bytes bytes(patch.encoded_bytes);
  LUMIGRID_TRY(log_.readAt(patch.offset + borderBytes(patch), bytes));
  return bytes;
}

base::Result<void> WorkStore::readWhole(const WorkPatch& patch, base::Bytes& bytes) const {
  bytes.resize(std::size_t{patch.encoded_bytes} + patch.carried_bytes);
  return log_.readAt(patch.offset + borderBytes(patch), bytes);
}

}  // namespace lod::patch::builder
