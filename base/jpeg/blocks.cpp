#include "base/jpeg/blocks.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

#include "base/check.h"
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
  for (int c = 0; c < jpeg.num_components; ++c)
    if (!isComplete(jpeg.dc_huff_tbl_ptrs[jpeg.comp_info[c].dc_tbl_no], true) ||
        !isComplete(jpeg.ac_huff_tbl_ptrs[jpeg.comp_info[c].ac_tbl_no], false))
      return false;
  return true;
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

// Holds libjpeg's decoder, in whose memory the blocks are.
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

  Result<void> read(ByteView bytes, std::uint64_t max_bytes) {
    LUMIGRID_TRY(readHeader(bytes));
    if (const char* fault = whyNot(jpeg_)) return Error{ErrorCode::kUnsupported, std::string("JPEG: ") + fault};
    std::uint64_t needed = 0;
    for (int c = 0; c < jpeg_.num_components; ++c)
      needed +=
          std::uint64_t{sizeof(JBLOCK)} * jpeg_.comp_info[c].width_in_blocks * jpeg_.comp_info[c].height_in_blocks;
    if (needed > max_bytes) return Error{ErrorCode::kUnsupported, "JPEG: too many blocks for memory"};
    LUMIGRID_TRY(readBlocks());
    LUMIGRID_TRY(notePlanes());
    return checkCoefficients();
  }

  const jpeg_decompress_struct& jpeg() const { return jpeg_; }
  const std::vector<JpegPlane>& planes() const { return planes_; }
  const JpegBlock* row(int plane, int y) const {
    return rows_[static_cast<std::size_t>(plane)][static_cast<std::size_t>(y)];
  }

 private:
  Result<void> readHeader(ByteView bytes) {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    jpeg_create_decompress(&jpeg_);
    jpeg_mem_src(&jpeg_, bytes.data(), static_cast<unsigned long>(bytes.size()));
    jpeg_read_header(&jpeg_, TRUE);
    return {};
  }

  Result<void> readBlocks() {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    arrays_ = jpeg_read_coefficients(&jpeg_);
    return {};
  }

  // Rows stay where they are, since libjpeg keeps arrays in memory as a whole.
  Result<void> notePlanes() {
    rows_.resize(static_cast<std::size_t>(jpeg_.num_components));
    for (int c = 0; c < jpeg_.num_components; ++c) {
      const jpeg_component_info& info = jpeg_.comp_info[c];
      JpegPlane& plane = planes_.emplace_back();
      plane.across = info.h_samp_factor;
      plane.down = info.v_samp_factor;
      plane.wide = static_cast<int>(info.width_in_blocks);
      plane.high = static_cast<int>(info.height_in_blocks);
      if (info.quant_table == nullptr) return broken("a plane is missing");
      std::copy_n(info.quant_table->quantval, 64, plane.quant.begin());
      if (std::count(plane.quant.begin(), plane.quant.end(), 0) > 0) return broken("a quantization by zero");
      if (*std::max_element(plane.quant.begin(), plane.quant.end()) > 255)
        return Error{ErrorCode::kUnsupported, "JPEG: a quantization that is not a baseline JPEG's"};
      rows_[static_cast<std::size_t>(c)].resize(static_cast<std::size_t>(plane.high));
      for (int y = 0; y < plane.high; ++y) LUMIGRID_TRY(noteRow(c, y));
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
  std::vector<std::vector<const JpegBlock*>> rows_;  // by plane
};

namespace {

using Fill = std::function<void(int plane, int y, JpegBlock* row)>;

// Writes one JPEG.
class Writer {
 public:
  Writer() { errors_.attach(jpeg_); }
  ~Writer() { jpeg_destroy_compress(&jpeg_); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  Result<void> write(const jpeg_decompress_struct& like, int width, int height, const Fill& fill, bool own_tables) {
    if (setjmp(errors_.failed) != 0) return broken(errors_.message.data());
    jpeg_create_compress(&jpeg_);
    jpeg_.dest = &destination_;
    // The source is read only, though libjpeg's interface does not say so.
    jpeg_copy_critical_parameters(const_cast<j_decompress_ptr>(&like), &jpeg_);
    jpeg_.image_width = static_cast<JDIMENSION>(width);
    jpeg_.image_height = static_cast<JDIMENSION>(height);
    jpeg_.optimize_coding = own_tables ? TRUE : FALSE;
    if (!own_tables) copyTables(like);
    requestArrays();
    jpeg_.mem->realize_virt_arrays(common());
    for (int c = 0; c < jpeg_.num_components; ++c)
      for (JDIMENSION y = 0; y < high_[c]; ++y) {
        JBLOCKARRAY rows = jpeg_.mem->access_virt_barray(common(), arrays_[c], y, 1, TRUE);
        fill(c, static_cast<int>(y), reinterpret_cast<JpegBlock*>(rows[0]));
      }
    jpeg_write_coefficients(&jpeg_, arrays_.data());
    jpeg_finish_compress(&jpeg_);
    return {};
  }
  Bytes takeBytes() { return std::move(bytes_); }

 private:
  j_common_ptr common() { return reinterpret_cast<j_common_ptr>(&jpeg_); }

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

  void requestArrays() {
    JDIMENSION across = 1, down = 1;
    for (int c = 0; c < jpeg_.num_components; ++c) {
      across = std::max(across, static_cast<JDIMENSION>(jpeg_.comp_info[c].h_samp_factor));
      down = std::max(down, static_cast<JDIMENSION>(jpeg_.comp_info[c].v_samp_factor));
    }
    const auto blocks = [](JDIMENSION pixels, JDIMENSION factor, JDIMENSION most) {
      return (pixels * factor + 8 * most - 1) / (8 * most);
    };
    for (int c = 0; c < jpeg_.num_components; ++c) {
      const auto h = static_cast<JDIMENSION>(jpeg_.comp_info[c].h_samp_factor);
      const auto v = static_cast<JDIMENSION>(jpeg_.comp_info[c].v_samp_factor);
      high_[c] = blocks(jpeg_.image_height, v, down);
      arrays_[c] = jpeg_.mem->request_virt_barray(common(), JPOOL_IMAGE, TRUE, blocks(jpeg_.image_width, h, across),
                                                  (high_[c] + v - 1) / v * v, v);
    }
  }

  jpeg_compress_struct jpeg_{};
  libjpeg::Errors errors_;
  Bytes bytes_;
  libjpeg::AppendedBytes destination_{bytes_};
  std::array<jvirt_barray_ptr, 4> arrays_{};
  std::array<JDIMENSION, 4> high_{};
};

}  // namespace

JpegBlocks::JpegBlocks(std::unique_ptr<Reader> reader) : reader_(std::move(reader)) {}
JpegBlocks::JpegBlocks(JpegBlocks&&) noexcept = default;
JpegBlocks& JpegBlocks::operator=(JpegBlocks&&) noexcept = default;
JpegBlocks::~JpegBlocks() = default;

Result<JpegBlocks> JpegBlocks::read(ByteView jpeg, std::uint64_t max_bytes) {
  if (jpeg.empty()) return broken("no bytes");
  auto reader = std::make_unique<Reader>();
  LUMIGRID_TRY(reader->read(jpeg, max_bytes));
  return JpegBlocks(std::move(reader));
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
const JpegBlock* JpegBlocks::block(int plane, int x, int y) const {
  return reader_->row(plane, y) + x;
}

Result<Bytes> JpegBlocks::encode(int width, int height, const Fill& fill) const {
  LUMIGRID_CHECK(width >= 1 && height >= 1 && std::max(width, height) <= 65500);
  Writer writer;
  LUMIGRID_TRY(writer.write(reader_->jpeg(), width, height, fill, !hasCompleteTables(reader_->jpeg())));
  return writer.takeBytes();
}

}  // namespace base
