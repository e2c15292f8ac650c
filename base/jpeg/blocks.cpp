#include "base/jpeg/blocks.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "base/check.h"
#include "base/jpeg/coded_units.h"
#include "base/jpeg/libjpeg.h"

namespace base {
namespace {

constexpr JDIMENSION kMaxSide = 16384;
static_assert(sizeof(JpegBlock) == sizeof(JBLOCK));

Error broken(const std::string& problem) {
  return {ErrorCode::kInvalidInput, "JPEG: " + problem};
}

// Whether a table has a code for every symbol of baseline JPEGs of 8 bits, and for no other (T.81, F.1.2.1 and
// F.1.2.2): the standard tables do. libjpeg does not look whether a symbol has a code.
bool isComplete(const JHUFF_TBL* table, bool means) {
  if (table == nullptr) return false;
  int symbols = 0, known = 0;
  for (int length = 1; length <= 16; ++length) symbols += table->bits[length];
  for (int i = 0; i < std::min(symbols, 256); ++i) {
    const int value = table->huffval[i], zeros = value >> 4, size = value & 15;
    known += means ? value <= 11 : value == 0x00 || value == 0xF0 || (size >= 1 && size <= 10 && zeros <= 15);
  }
  return symbols == known && known == (means ? 12 : 162);
}

bool hasCompleteTables(const jpeg_decompress_struct& jpeg) {
  if (jpeg.progressive_mode != FALSE || jpeg.arith_code != FALSE) return false;
  const auto known = [](int table) { return table >= 0 && table < NUM_HUFF_TBLS; };
  for (int c = 0; c < jpeg.num_components; ++c) {
    const jpeg_component_info& plane = jpeg.comp_info[c];
    if (!known(plane.dc_tbl_no) || !isComplete(jpeg.dc_huff_tbl_ptrs[plane.dc_tbl_no], true) ||
        !known(plane.ac_tbl_no) || !isComplete(jpeg.ac_huff_tbl_ptrs[plane.ac_tbl_no], false))
      return false;
  }
  return true;
}

// Whether all planes are coded in one scan, unit by unit, without restarts.
bool isOneScan(const jpeg_decompress_struct& jpeg) {
  if (jpeg.restart_interval != 0 || jpeg.comps_in_scan != jpeg.num_components) return false;
  for (int c = 0; c < jpeg.num_components; ++c)
    if (jpeg.cur_comp_info[c] != &jpeg.comp_info[c] || jpeg.comp_info[c].quant_tbl_no >= NUM_QUANT_TBLS) return false;
  return jpeg.Ss == 0 && jpeg.Se == DCTSIZE2 - 1 && jpeg.Ah == 0 && jpeg.Al == 0;
}

std::shared_ptr<const jpeg::HuffmanTable> tableOf(const JHUFF_TBL& table) {
  auto made = jpeg::HuffmanTable::make(table.bits, table.huffval);
  return made ? std::make_shared<const jpeg::HuffmanTable>(*made) : nullptr;
}

// Why the blocks of a JPEG with this header are not read; null where they are.
const char* whyNot(const jpeg_decompress_struct& jpeg) {
  if (std::max(jpeg.image_width, jpeg.image_height) > kMaxSide) return "a side over 16384";
  if (jpeg.data_precision != 8) return "not 8 bits a sample";
  const bool grey = jpeg.num_components == 1 && jpeg.jpeg_color_space == JCS_GRAYSCALE;
  if (!grey && (jpeg.num_components != 3 || jpeg.jpeg_color_space != JCS_YCbCr)) return "neither grey nor YCbCr";
  for (int c = 0; c < jpeg.num_components; ++c) {
    const int limit = c == 0 && !grey ? 2 : 1;
    const jpeg_component_info& plane = jpeg.comp_info[c];
    if (plane.h_samp_factor > limit || plane.v_samp_factor > limit) return "an uncommon sampling of colours";
  }
  return nullptr;
}

}  // namespace

namespace {

// A new JPEG's units. `rows[plane]`: blocks of a row of the plane of this JPEG.
using Rows = std::function<const JpegBlock*(int plane, int y)>;

// Writes one JPEG with libjpeg.
class Writer {
 public:
  Writer() { errors_.attach(jpeg_); }
  ~Writer() { jpeg_destroy_compress(&jpeg_); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  // `rows` are the blocks that units are copied from.
  Result<void> write(const jpeg_decompress_struct& like, int across, int down, const JpegBlocks::Units& unit,
                     const Rows& rows, bool own_tables) {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    jpeg_create_compress(&jpeg_);
    jpeg_.dest = &destination_;
    // The source is read only, though libjpeg's interface does not say so.
    jpeg_copy_critical_parameters(const_cast<j_decompress_ptr>(&like), &jpeg_);
    jpeg_.image_width = static_cast<JDIMENSION>(across * DCTSIZE * jpeg_.comp_info[0].h_samp_factor);
    jpeg_.image_height = static_cast<JDIMENSION>(down * DCTSIZE * jpeg_.comp_info[0].v_samp_factor);
    jpeg_.optimize_coding = own_tables ? TRUE : FALSE;
    if (!own_tables) copyTables(like);
    for (int c = 0; c < jpeg_.num_components; ++c) {
      const auto h = static_cast<JDIMENSION>(jpeg_.comp_info[c].h_samp_factor);
      const auto v = static_cast<JDIMENSION>(jpeg_.comp_info[c].v_samp_factor);
      arrays_[c] = jpeg_.mem->request_virt_barray(common(), JPOOL_IMAGE, TRUE, static_cast<JDIMENSION>(across) * h,
                                                  static_cast<JDIMENSION>(down) * v, v);
    }
    jpeg_.mem->realize_virt_arrays(common());
    for (int y = 0; y < down; ++y) writeUnits(across, y, unit, rows);
    jpeg_write_coefficients(&jpeg_, arrays_.data());
    jpeg_finish_compress(&jpeg_);
    return {};
  }
  Bytes takeBytes() { return std::move(bytes_); }

 private:
  j_common_ptr common() { return reinterpret_cast<j_common_ptr>(&jpeg_); }

  // Writes a row of units to the arrays. No errors of libjpeg jump out of it but those of its memory.
  void writeUnits(int across, int y, const JpegBlocks::Units& unit, const Rows& rows) {
    std::array<std::array<JpegBlock*, 2>, 3> to{};
    for (int c = 0; c < jpeg_.num_components; ++c) {
      const int down = jpeg_.comp_info[c].v_samp_factor;
      JBLOCKARRAY at = jpeg_.mem->access_virt_barray(common(), arrays_[c], static_cast<JDIMENSION>(y * down),
                                                     static_cast<JDIMENSION>(down), TRUE);
      for (int j = 0; j < down; ++j) to[c][j] = reinterpret_cast<JpegBlock*>(at[j]);
    }
    std::array<JpegBlock, jpeg::CodedUnits::kMaxBlocks> blocks;
    for (int x = 0; x < across; ++x) {
      const std::optional<std::array<int, 2>> from = unit(x, y, blocks.data());
      const JpegBlock* next = blocks.data();
      for (int c = 0; c < jpeg_.num_components; ++c) {
        const int wide = jpeg_.comp_info[c].h_samp_factor, down = jpeg_.comp_info[c].v_samp_factor;
        for (int j = 0; j < down; ++j, next += wide) {
          const JpegBlock* source = from ? rows(c, (*from)[1] * down + j) + std::ptrdiff_t{(*from)[0]} * wide : next;
          std::copy_n(source, wide, to[c][j] + std::ptrdiff_t{x} * wide);
        }
      }
    }
  }

  void copyTables(const jpeg_decompress_struct& like) {
    const auto copy = [this](const JHUFF_TBL* from, JHUFF_TBL*& to) {
      if (from == nullptr) return;
      if (to == nullptr) to = jpeg_alloc_huff_table(common());
      std::memcpy(to, from, sizeof(*to));
      to->sent_table = FALSE;
    };
    for (int c = 0; c < jpeg_.num_components; ++c) {
      jpeg_.comp_info[c].dc_tbl_no = like.comp_info[c].dc_tbl_no;
      jpeg_.comp_info[c].ac_tbl_no = like.comp_info[c].ac_tbl_no;
    }
    for (int t = 0; t < NUM_HUFF_TBLS; ++t) {
      copy(like.dc_huff_tbl_ptrs[t], jpeg_.dc_huff_tbl_ptrs[t]);
      copy(like.ac_huff_tbl_ptrs[t], jpeg_.ac_huff_tbl_ptrs[t]);
    }
  }

  jpeg_compress_struct jpeg_{};
  libjpeg::Errors errors_;
  Bytes bytes_;
  libjpeg::AppendedBytes destination_{bytes_};
  std::array<jvirt_barray_ptr, 4> arrays_{};
};

// All of a JPEG before the coded units, and where its size stands.
struct Front {
  Bytes bytes;
  std::size_t size_at = 0;  // u16 height and width, highest byte first
};

Front frontOf(Bytes jpeg) {
  Front front;
  std::size_t at = 2;
  for (;;) {
    LUMIGRID_CHECK(at + 4 <= jpeg.size() && jpeg[at] == 0xFF);
    const int marker = jpeg[at + 1];
    if (marker == 0xC0 || marker == 0xC1) front.size_at = at + 5;
    at += 2 + (std::size_t{jpeg[at + 2]} << 8 | jpeg[at + 3]);
    if (marker == 0xDA) break;
  }
  LUMIGRID_CHECK(front.size_at != 0);
  jpeg.resize(at);
  front.bytes = std::move(jpeg);
  return front;
}

}  // namespace

// Holds a JPEG's coded units, or libjpeg's decoder, in whose memory the blocks are.
class JpegBlocks::Reader {
 public:
  Reader() {
    errors_.attach(jpeg_);
    // A warning means broken data and a picture with grey parts.
    errors_.manager.emit_message = [](j_common_ptr jpeg, int level) {
      if (level < 0) jpeg->err->error_exit(jpeg);
    };
  }
  ~Reader() { jpeg_destroy_decompress(&jpeg_); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  Result<void> read(ByteView bytes, std::uint64_t max_bytes, ByteView index) {
    LUMIGRID_TRY(readFront(bytes));
    if (const auto coded = codedUnits(bytes)) {
      units_ = jpeg::CodedUnits::read(coded->first, coded->second, max_bytes, index);
      if (units_) {
        if (writeFront(coded->first)) return notePlanes(true);
        units_.reset();
      }
    }
    std::uint64_t needed = 0;
    for (int c = 0; c < jpeg_.num_components; ++c)
      needed +=
          std::uint64_t{sizeof(JBLOCK)} * jpeg_.comp_info[c].width_in_blocks * jpeg_.comp_info[c].height_in_blocks;
    if (needed > max_bytes) return Error{ErrorCode::kUnsupported, "JPEG: too many blocks for memory"};
    LUMIGRID_TRY(readBlocks());
    LUMIGRID_TRY(notePlanes(false));
    LUMIGRID_TRY(noteRows());
    return checkCoefficients();
  }

  std::optional<JpegBlocks::Quarter> readQuarter(ByteView bytes, std::uint64_t max_bytes) {
    if (!readFront(bytes)) return std::nullopt;
    const auto coded = codedUnits(bytes);
    if (!coded || !notePlanes(true)) return std::nullopt;
    JpegBlocks::Quarter made;
    const auto quarterOf = [](JDIMENSION side) { return static_cast<int>(std::max<JDIMENSION>(1, side / 4)); };
    jpeg::QuarterRows rows;
    rows.blocks_across = static_cast<std::size_t>(planes_[0].across);
    rows.blocks_down = static_cast<std::size_t>(planes_[0].down);
    for (std::size_t c = 0; c < planes_.size(); ++c)
      rows.weights.emplace_back(planes_[c].quant, jpeg::kZigzag, c == 0 ? 2 : 2 * rows.blocks_across,
                                c == 0 ? 2 : 2 * rows.blocks_down);
    rows.take = [&](std::size_t row, const jpeg::QuarterRow& samples) {
      // A header that lies takes no memory for pixels.
      if (row == 0) made.picture = Image(quarterOf(jpeg_.image_width), quarterOf(jpeg_.image_height), 3);
      paintRow(row, samples, made.picture);
    };
    const auto units = jpeg::CodedUnits::readQuarter(coded->first, coded->second, max_bytes, rows);
    if (!units) return std::nullopt;
    made.units = units->index();
    return made;
  }

  const jpeg_decompress_struct& jpeg() const { return jpeg_; }
  const std::vector<JpegPlane>& planes() const { return planes_; }

  JpegBlock block(int plane, int x, int y) const {
    if (!units_) return row(plane, y)[x];
    const auto [unit, within] = placeOf(plane, x, y);
    JpegBlock block;
    std::array<JpegBlock*, jpeg::CodedUnits::kMaxBlocks> wanted{};
    wanted[within] = &block;
    units_->decode(unit, std::span(wanted).first(within + 1));
    return block;
  }
  int mean(int plane, int x, int y) const {
    if (!units_) return row(plane, y)[x][0];
    const auto [unit, within] = placeOf(plane, x, y);
    return units_->mean(unit, within);
  }
  void blocksAt(int x, int y, std::array<JpegBlock, 3>& blocks) const {
    std::array<JpegBlock*, jpeg::CodedUnits::kMaxBlocks> wanted{};
    std::size_t unit = 0, end = 0;
    for (std::size_t c = 0; c < planes_.size(); ++c) {
      const JpegPlane &plane = planes_[c], &first = planes_[0];
      const int column = x * plane.across / (DCTSIZE * first.across),
                row_number = y * plane.down / (DCTSIZE * first.down);
      if (!units_) {
        blocks[c] = row(static_cast<int>(c), row_number)[column];
        continue;
      }
      std::size_t within = 0;
      std::tie(unit, within) = placeOf(static_cast<int>(c), column, row_number);
      wanted[within] = &blocks[c];
      end = within + 1;
    }
    if (units_) units_->decode(unit, std::span(wanted).first(end));
  }

  void unitBlocks(int x, int y, std::array<JpegBlock, JpegBlocks::kMostInUnit>& blocks) const {
    std::array<JpegBlock*, JpegBlocks::kMostInUnit> wanted{};
    std::size_t count = 0;
    for (int c = 0; c < static_cast<int>(planes_.size()); ++c) {
      const JpegPlane& p = planes_[static_cast<std::size_t>(c)];
      for (int j = p.down * y; j < p.down * (y + 1); ++j)
        for (int i = p.across * x; i < p.across * (x + 1); ++i, ++count) {
          wanted[count] = &blocks[count];
          if (!units_ && i < p.wide && j < p.high) blocks[count] = row(c, j)[i];
        }
    }
    if (!units_) return;
    const auto unit = static_cast<std::size_t>(y) * unitsAcross() + static_cast<std::size_t>(x);
    units_->decode(unit, std::span(wanted).first(count));
  }

  Result<Bytes> encode(int across, int down, const Units& unit) const {
    if (!units_) {
      Writer writer;
      const Rows rows = [this](int plane, int y) { return row(plane, y); };
      LUMIGRID_TRY(writer.write(jpeg_, across, down, unit, rows, !hasCompleteTables(jpeg_)));
      return writer.takeBytes();
    }
    Bytes out = front_.bytes;
    const int width = across * DCTSIZE * planes_[0].across, height = down * DCTSIZE * planes_[0].down;
    std::size_t at = front_.size_at;
    for (const int side : {height, width})
      for (const int shift : {8, 0}) out[at++] = static_cast<std::uint8_t>(side >> shift);
    const auto source = [&](std::size_t i, JpegBlock* blocks) -> std::optional<std::size_t> {
      const auto wide = static_cast<std::size_t>(across);
      const auto from = unit(static_cast<int>(i % wide), static_cast<int>(i / wide), blocks);
      if (!from) return std::nullopt;
      return static_cast<std::size_t>((*from)[1]) * unitsAcross() + static_cast<std::size_t>((*from)[0]);
    };
    units_->encode(static_cast<std::size_t>(across) * static_cast<std::size_t>(down), source, out);
    out.push_back(0xFF);
    out.push_back(0xD9);
    return out;
  }

 private:
  static std::size_t unitsAlong(JDIMENSION pixels, int blocks) {
    const auto unit = static_cast<std::size_t>(DCTSIZE * blocks);
    return (pixels + unit - 1) / unit;
  }
  std::size_t unitsAcross() const { return unitsAlong(jpeg_.image_width, planes_[0].across); }
  // The unit of a block, and the block's number in it.
  std::pair<std::size_t, std::size_t> placeOf(int plane, int x, int y) const {
    const JpegPlane& p = planes_[static_cast<std::size_t>(plane)];
    const auto unit = static_cast<std::size_t>(y / p.down) * unitsAcross() + static_cast<std::size_t>(x / p.across);
    const int before = plane == 0 ? 0 : planes_[0].across * planes_[0].down + plane - 1;
    return {unit, static_cast<std::size_t>(before + y % p.down * p.across + x % p.across)};
  }
  const JpegBlock* row(int plane, int y) const {
    return rows_[static_cast<std::size_t>(plane)][static_cast<std::size_t>(y)];
  }

  Result<void> readHeader(ByteView bytes) {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    jpeg_create_decompress(&jpeg_);
    jpeg_mem_src(&jpeg_, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&jpeg_, TRUE);
    return {};
  }

  Result<void> readFront(ByteView bytes) {
    LUMIGRID_TRY(readHeader(bytes));
    if (const char* fault = whyNot(jpeg_)) return Error{ErrorCode::kUnsupported, std::string("JPEG: ") + fault};
    return {};
  }

  // How the units are coded and their bytes, if they can stay coded.
  std::optional<std::pair<jpeg::UnitLayout, ByteView>> codedUnits(ByteView bytes) const {
    if (!isOneScan(jpeg_) || !hasCompleteTables(jpeg_)) return std::nullopt;
    jpeg::UnitLayout layout;
    const jpeg_component_info& first = jpeg_.comp_info[0];
    layout.across = unitsAlong(jpeg_.image_width, first.h_samp_factor);
    layout.down = unitsAlong(jpeg_.image_height, first.v_samp_factor);
    layout.first_blocks = static_cast<std::size_t>(first.h_samp_factor * first.v_samp_factor);
    for (int c = 0; c < jpeg_.num_components; ++c) {
      const auto means = tableOf(*jpeg_.dc_huff_tbl_ptrs[jpeg_.comp_info[c].dc_tbl_no]);
      const auto others = tableOf(*jpeg_.ac_huff_tbl_ptrs[jpeg_.comp_info[c].ac_tbl_no]);
      if (!means || !others) return std::nullopt;
      layout.planes.push_back({means, others});
    }
    return std::pair(layout, bytes.subspan(static_cast<std::size_t>(jpeg_.src->next_input_byte - bytes.data())));
  }

  // Makes what a JPEG of such units has before them.
  bool writeFront(const jpeg::UnitLayout& layout) {
    Writer writer;
    const auto even = [&](int, int, JpegBlock* blocks) {
      std::fill_n(blocks, layout.blocks(), JpegBlock{});
      return std::optional<std::array<int, 2>>();
    };
    if (!writer.write(jpeg_, 1, 1, even, nullptr, false)) return false;
    front_ = frontOf(writer.takeBytes());
    return true;
  }

  // Turns a row of units into pixels (JFIF 1.02, section 7: RGB of YCbCr), as far as they lie in the picture.
  void paintRow(std::size_t row, const jpeg::QuarterRow& samples, Image& picture) const {
    const std::size_t wide = std::min(samples.wide, static_cast<std::size_t>(picture.width));
    const std::vector<float> grey(planes_.size() == 1 ? wide : 0, 0.0F);
    for (std::size_t y = 0; y < samples.down; ++y) {
      const std::size_t line = samples.down * row + y;
      if (line >= static_cast<std::size_t>(picture.height)) return;
      const std::size_t at = samples.wide * y;
      const float* const luma = samples.planes[0].data() + at;
      const float* const cb = grey.empty() ? samples.planes[1].data() + at : grey.data();
      const float* const cr = grey.empty() ? samples.planes[2].data() + at : grey.data();
      const auto inRange = [](float value, float least, float most) {
        return value < least ? least : value > most ? most : value;
      };
      std::uint8_t* to = picture.at(0, static_cast<int>(line));
      for (std::size_t x = 0; x < wide; ++x, to += 3) {
        const float l = inRange(luma[x], -128.0F, 127.0F) + 128.5F;
        const float b = inRange(cb[x], -128.0F, 127.0F), r = inRange(cr[x], -128.0F, 127.0F);
        to[0] = static_cast<std::uint8_t>(inRange(l + 1.402F * r, 0.0F, 255.0F));
        to[1] = static_cast<std::uint8_t>(inRange(l - 0.344136F * b - 0.714136F * r, 0.0F, 255.0F));
        to[2] = static_cast<std::uint8_t>(inRange(l + 1.772F * b, 0.0F, 255.0F));
      }
    }
  }

  Result<void> readBlocks() {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    arrays_ = jpeg_read_coefficients(&jpeg_);
    return {};
  }

  // `ahead`: before the first scan.
  Result<void> notePlanes(bool ahead) {
    for (int c = 0; c < jpeg_.num_components; ++c) {
      const jpeg_component_info& info = jpeg_.comp_info[c];
      JpegPlane& plane = planes_.emplace_back();
      plane.across = info.h_samp_factor;
      plane.down = info.v_samp_factor;
      plane.wide = static_cast<int>(info.width_in_blocks);
      plane.high = static_cast<int>(info.height_in_blocks);
      const JQUANT_TBL* const table = ahead ? jpeg_.quant_tbl_ptrs[info.quant_tbl_no] : info.quant_table;
      if (table == nullptr) return broken("a plane is missing");
      std::copy_n(table->quantval, 64, plane.quant.begin());
      if (std::count(plane.quant.begin(), plane.quant.end(), 0) > 0) return broken("a quantization by zero");
      if (*std::max_element(plane.quant.begin(), plane.quant.end()) > 255)
        return Error{ErrorCode::kUnsupported, "JPEG: a quantization that is not a baseline JPEG's"};
    }
    return {};
  }

  // Coefficients of samples of 8 bits lie in these ranges, and so have a code each, as have differences of means.
  Result<void> checkCoefficients() const {
    for (std::size_t c = 0; c < rows_.size(); ++c)
      for (const JpegBlock* row : rows_[c])
        for (int x = 0; x < planes_[c].wide; ++x) {
          const JpegBlock& block = row[x];
          // Over the whole block, so that a compiler can take many coefficients at a time.
          std::int16_t least = 0, most = 0;
          for (const std::int16_t coefficient : block)
            least = std::min(least, coefficient), most = std::max(most, coefficient);
          if (most > 1023 || (least < -1023 && !isMeanAlone(block)))
            return Error{ErrorCode::kUnsupported, "JPEG: a coefficient is out of range"};
        }
    return {};
  }
  // Whether nothing but the mean is below -1023, and that by no more than one.
  static bool isMeanAlone(const JpegBlock& block) {
    return block[0] >= -1024 && *std::min_element(block.begin() + 1, block.end()) >= -1023;
  }

  // Rows stay where they are, since libjpeg keeps arrays in memory as a whole.
  Result<void> noteRows() {
    rows_.resize(planes_.size());
    for (std::size_t c = 0; c < planes_.size(); ++c) {
      rows_[c].resize(static_cast<std::size_t>(planes_[c].high));
      for (int y = 0; y < planes_[c].high; ++y) LUMIGRID_TRY(noteRow(static_cast<int>(c), y));
    }
    return {};
  }
  Result<void> noteRow(int plane, int y) {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    JBLOCKARRAY at = jpeg_.mem->access_virt_barray(reinterpret_cast<j_common_ptr>(&jpeg_), arrays_[plane],
                                                   static_cast<JDIMENSION>(y), 1, FALSE);
    rows_[static_cast<std::size_t>(plane)][static_cast<std::size_t>(y)] = reinterpret_cast<const JpegBlock*>(at[0]);
    return {};
  }

  jpeg_decompress_struct jpeg_{};
  libjpeg::Errors errors_;
  jvirt_barray_ptr* arrays_ = nullptr;
  std::vector<JpegPlane> planes_;
  std::optional<jpeg::CodedUnits> units_;
  Front front_;                                      // with units_
  std::vector<std::vector<const JpegBlock*>> rows_;  // by plane, without units_
};

JpegBlocks::JpegBlocks(std::unique_ptr<Reader> reader) : reader_(std::move(reader)) {}
JpegBlocks::JpegBlocks(JpegBlocks&&) noexcept = default;
JpegBlocks& JpegBlocks::operator=(JpegBlocks&&) noexcept = default;
JpegBlocks::~JpegBlocks() = default;

Result<JpegBlocks> JpegBlocks::read(ByteView jpeg, std::uint64_t max_bytes, ByteView units) {
  if (jpeg.empty()) return broken("no bytes");
  auto reader = std::make_unique<Reader>();
  LUMIGRID_TRY(reader->read(jpeg, max_bytes, units));
  return JpegBlocks(std::move(reader));
}

std::optional<JpegBlocks::Quarter> JpegBlocks::readQuarter(ByteView jpeg, std::uint64_t max_bytes) {
  if (jpeg.empty()) return std::nullopt;
  Reader reader;
  return reader.readQuarter(jpeg, max_bytes);
}

int JpegBlocks::width() const {
  return static_cast<int>(reader_->jpeg().image_width);
}
int JpegBlocks::height() const {
  return static_cast<int>(reader_->jpeg().image_height);
}
int JpegBlocks::planes() const {
  return static_cast<int>(reader_->planes().size());
}
const JpegPlane& JpegBlocks::plane(int number) const {
  return reader_->planes()[static_cast<std::size_t>(number)];
}
JpegBlock JpegBlocks::block(int plane, int x, int y) const {
  return reader_->block(plane, x, y);
}
int JpegBlocks::mean(int plane, int x, int y) const {
  return reader_->mean(plane, x, y);
}
void JpegBlocks::blocksAt(int x, int y, std::array<JpegBlock, 3>& blocks) const {
  reader_->blocksAt(x, y, blocks);
}
void JpegBlocks::unitBlocks(int x, int y, std::array<JpegBlock, kMostInUnit>& blocks) const {
  reader_->unitBlocks(x, y, blocks);
}

Result<Bytes> JpegBlocks::encode(int across, int down, const Units& unit) const {
  LUMIGRID_CHECK(across >= 1 && down >= 1);
  LUMIGRID_CHECK(std::max(across * unitWidth(), down * unitHeight()) <= 65500);
  return reader_->encode(across, down, unit);
}

}  // namespace base
