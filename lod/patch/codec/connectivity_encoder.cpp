#include "lod/patch/codec/connectivity_encoder.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "base/check.h"
#include "base/simd.h"
#include "lod/patch/codec/header.h"

namespace lod::patch::codec {
namespace {

// Packs steps of two bits each, from the lowest bits of a byte up.
class StepWriter {
 public:
  void add(std::uint32_t step) {
    current_ |= step << (2 * (count_++ % 4));
    if (count_ % 4 != 0) return;
    bytes_.push_back(static_cast<std::uint8_t>(current_));
    current_ = 0;
  }
  std::uint32_t count() const { return count_; }
  base::Bytes takeBytes() {
    if (count_ % 4 != 0) bytes_.push_back(static_cast<std::uint8_t>(current_));
    return std::move(bytes_);
  }

 private:
  base::Bytes bytes_;
  std::uint32_t current_ = 0;
  std::uint32_t count_ = 0;
};

// A triangle at a vertex, and its last corner seen from there.
struct TriangleUse {
  std::uint16_t triangle = 0;
  std::uint16_t third = 0;
};

// How a triangle can be attached to the gate: the higher, the cheaper.
enum Attachment : int {
  kSeveralTriangles = -2,  // triangles share the gate's edge in one direction
  kNoTriangle = -1,
  kAtKnownVertex = 0,
  kAtNewVertex = 1,
  kAtLastEdge = 2,   // at the start of the front's last edge
  kAtFirstEdge = 3,  // at the end of the front's first edge
};
struct FoundTriangle {
  TriangleUse use;
  int attachment = kNoTriangle;
};

// Finds the triangle behind an edge at once where no edge is used twice in the same direction, as on any manifold
// surface. Elsewhere encode() stops, and a careful encoder has to look at the triangles one by one.
class ConnectivityEncoder {
 public:
  ConnectivityEncoder(const PatchGeometry& geometry, bool careful)
      : geometry_(geometry),
        triangles_(static_cast<std::uint32_t>(geometry.indices.size() / 3)),
        careful_(careful),
        first_use_(geometry.positions.size() + 2, 0),
        uses_(geometry.indices.size()),
        next_(geometry.indices.size() + kLanes, 0),
        is_encoded_(triangles_, 0),
        new_number_(geometry.positions.size(), kUnnumbered),
        front_(2 * std::size_t{triangles_} + 1) {
    sortUsesByVertex();
    out_.indices.resize(geometry.indices.size());
    out_.triangles.resize(triangles_);
    out_.vertices.resize(geometry.positions.size() + 1);
    out_.gates.resize(geometry.positions.size() + 1);
  }

  // False when the surface needs a careful encoder.
  bool encode() {
    std::uint32_t next = 0;
    while (triangle_count_ < triangles_) {
      if (has_gate_) {
        if (!encodeStep()) return false;
        continue;
      }
      while (is_encoded_[next] != 0) ++next;
      startComponent(next);
    }
    return true;
  }

  EncodedConnectivity takeResult() {
    out_.vertices.resize(vertex_count_);
    out_.gates.resize(vertex_count_);
    out_.steps = steps_.count();
    out_.step_bytes = steps_.takeBytes();
    for (std::size_t i = known_.size(); i-- > 0;) {
      out_.escapes.push_back(static_cast<std::uint8_t>(known_[i] & 255U));
      out_.escapes.push_back(static_cast<std::uint8_t>(known_[i] >> 8));
    }
    out_.front_bits = static_cast<std::uint8_t>(std::bit_width(longest_front_ + 1));
    LUMIGRID_CHECK_LE(out_.front_bits, kMaxFrontBits);
    return std::move(out_);
  }

 private:
  static constexpr std::uint32_t kUnnumbered = ~0U;
  // The most unused triangles that are looked at around one vertex: more than any scan has, and few enough that a fan
  // of thousands stays cheap.
  static constexpr std::uint32_t kMaxLooked = 64;
  static constexpr std::uint32_t kLanes = 8;

  void sortUsesByVertex() {
    // Each vertex's first use comes to stand one place behind, and moves to the next one's as uses are added.
    for (const std::uint16_t v : geometry_.indices) ++first_use_[std::size_t{v} + 2];
    for (std::size_t v = 2; v < first_use_.size(); ++v) {
      careful_ = careful_ || first_use_[v] > kMaxLooked;
      first_use_[v] += first_use_[v - 1];
    }
    for (std::uint32_t t = 0; t < triangles_; ++t) {
      const std::uint16_t* c = &geometry_.indices[3 * std::size_t{t}];
      addUse(c[0], c[1], {static_cast<std::uint16_t>(t), c[2]});
      addUse(c[1], c[2], {static_cast<std::uint16_t>(t), c[0]});
      addUse(c[2], c[0], {static_cast<std::uint16_t>(t), c[1]});
    }
    if (!careful_) return;
    unused_.resize(geometry_.positions.size());
    for (std::size_t v = 0; v < unused_.size(); ++v) unused_[v] = first_use_[v + 1] - first_use_[v];
  }
  void addUse(std::uint16_t v, std::uint16_t next, const TriangleUse& use) {
    const std::uint32_t at = first_use_[std::size_t{v} + 1]++;
    uses_[at] = use;
    next_[at] = next;
  }

  // One edge of the triangle starts a component. Its known corners come first: an edge, then the triangle on it.
  void startComponent(std::uint32_t t) {
    std::array<std::uint16_t, 3> c{};
    std::memcpy(c.data(), &geometry_.indices[3 * std::size_t{t}], sizeof(c));
    const auto later = [&](std::size_t a, std::size_t b) { return !isKnown(c[a]) && isKnown(c[b]); };
    while (later(0, 1) || later(1, 2)) std::rotate(c.begin(), c.begin() + 1, c.end());

    const std::size_t at = out_.escapes.size();
    escape(kStart);
    std::uint16_t before = vertex_count_ == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(vertex_count_ - 1);
    for (std::size_t k = 0; k < 2; ++k) {
      if (isKnown(c[k])) {
        out_.escapes[at] = static_cast<std::uint8_t>(out_.escapes[at] + (1U << k));
        known_.push_back(numberOf(c[k]));
      } else {
        addVertex(c[k], {before, before, before});
      }
      before = numberOf(c[k]);
    }
    pushEdge({c[1], c[0], isKnown(c[2]) ? c[0] : c[2]});
    gate_ = {c[0], c[1], c[0]};
    if (isKnown(c[2]))
      attachAtKnown({{static_cast<std::uint16_t>(t), c[2]}, kAtKnownVertex});
    else
      attachAtNewOrFirst({static_cast<std::uint16_t>(t), c[2]}, true);
    has_gate_ = true;
  }

  bool encodeStep() {
    FoundTriangle found = careful_ ? findCheapest() : findOnly(gate_);
    if (found.attachment == kSeveralTriangles) return false;
    if (found.attachment == kAtKnownVertex && !careful_ && foldUpTo(found.use.third)) found.attachment = kAtFirstEdge;
    if (found.attachment == kNoTriangle)
      giveUpGate();
    else if (found.attachment == kAtNewVertex || found.attachment == kAtFirstEdge)
      attachAtNewOrFirst(found.use, found.attachment == kAtNewVertex);
    else
      attachAtKnown(found);
    return true;
  }

  int attachmentOf(std::uint16_t third) const {
    int attachment = new_number_[third] == kUnnumbered ? kAtNewVertex : kAtKnownVertex;
    if (!isFrontEmpty() && third == front_[tail_ - 1].a) attachment = kAtLastEdge;
    if (!isFrontEmpty() && third == front_[head_].b) attachment = kAtFirstEdge;
    return attachment;
  }

  // The unused triangle with that edge; kSeveralTriangles where triangles share it, used or not.
  FoundTriangle findOnly(const FrontEdge& edge) const {
    const std::uint32_t begin = first_use_[edge.a];
    const std::uint32_t end = first_use_[std::size_t{edge.a} + 1];
    std::uint32_t place = end;
    for (std::uint32_t i = begin; i < end; i += kLanes) {
      base::Ushort8 next;
      std::memcpy(&next, &next_[i], sizeof(next));
      auto same = base::bitCast<std::uint64_t>(__builtin_convertvector(next == edge.b, base::Char8));
      if (end - i < kLanes) same &= (std::uint64_t{1} << (8 * (end - i))) - 1;
      if (same == 0) continue;
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(same)) / 8;
      if (place != end || (same & ~(std::uint64_t{255} << (8 * lane))) != 0) return {{}, kSeveralTriangles};
      place = i + lane;
    }
    if (place == end || is_encoded_[uses_[place].triangle] != 0) return {};
    return {uses_[place], attachmentOf(uses_[place].third)};
  }

  // Among the unused triangles with the gate's edge, the one that costs least.
  FoundTriangle findCheapest() {
    FoundTriangle cheapest;
    TriangleUse* uses = uses_.data() + first_use_[gate_.a];
    std::uint16_t* next = next_.data() + first_use_[gate_.a];
    std::uint32_t& unused = unused_[gate_.a];
    std::uint32_t looked = 0;
    for (std::uint32_t i = 0; i < unused && looked < kMaxLooked;) {
      if (is_encoded_[uses[i].triangle] != 0) {
        --unused;
        uses[i] = uses[unused];
        next[i] = next[unused];
        continue;
      }
      const TriangleUse& use = uses[i];
      ++looked;
      if (next[i++] != gate_.b) continue;
      if (const int attachment = attachmentOf(use.third); attachment > cheapest.attachment)
        cheapest = {use, attachment};
    }
    return cheapest;
  }

  // Where the third corner is a little ahead on the front and triangles at the gate's end fill what lies between, these
  // are written first, as folds; the front's first edge then ends at the third corner. Splitting the front, and all
  // that closes it again, would cost more.
  bool foldUpTo(std::uint16_t third) {
    constexpr std::size_t kMaxFolds = 3;
    std::array<FoundTriangle, kMaxFolds> between;
    std::size_t folds = 0;
    for (std::uint16_t end = gate_.b; folds <= kMaxFolds && head_ + folds < tail_; ++folds) {
      const FrontEdge& edge = front_[head_ + folds];
      if (edge.a != end) return false;
      end = edge.b;
      if (folds > 0) {
        FoundTriangle& found = between[folds - 1];
        found = findOnly(edge);
        // An edge at the gate's end would count its triangle twice.
        const bool touches = edge.a == gate_.b || edge.b == gate_.b;
        if (touches || found.attachment < 0 || found.use.third != gate_.b) return false;
      }
      if (end != third) continue;
      for (std::size_t i = 0; i < folds; ++i) {
        escape(kFold);
        const FrontEdge& folded = front_[++head_];
        addTriangle(between[i].use.triangle, gate_.b, folded.a, folded.b);
      }
      return true;
    }
    return false;
  }

  void giveUpGate() {
    const auto closes = [&](const FrontEdge& e) { return e.a == gate_.b && e.b == gate_.a; };
    if (!isFrontEmpty() && closes(front_[tail_ - 1])) {
      escape(kCloseLast);
      --tail_;
    } else if (!isFrontEmpty() && closes(front_[head_])) {
      escape(kCloseFirst);
      ++head_;
    } else {
      steps_.add(kGiveUp);
    }
    has_gate_ = !isFrontEmpty();
    if (has_gate_) gate_ = front_[head_++];
  }

  // Which of the two it is cannot be predicted by a branch: both are computed, and one counts.
  void attachAtNewOrFirst(const TriangleUse& use, bool is_new) {
    const FrontEdge gate = gate_;
    const std::uint16_t third = use.third;
    steps_.add(is_new ? kNewVertex : kNext);
    out_.vertices[vertex_count_] = third;
    out_.gates[vertex_count_] = {numberOf(gate.a), numberOf(gate.b), numberOf(gate.opposite)};
    new_number_[third] = is_new ? vertex_count_ : new_number_[third];
    front_[tail_] = {gate.a, third, gate.b};
    gate_ = {is_new ? third : gate.a, is_new ? gate.b : third, is_new ? gate.a : gate.b};
    vertex_count_ += is_new ? 1 : 0;
    tail_ += is_new ? 1 : 0;
    head_ += is_new ? 0 : 1;
    longest_front_ = std::max(longest_front_, tail_ - head_);
    addTriangle(use.triangle, gate.a, gate.b, third);
  }

  void attachAtKnown(const FoundTriangle& found) {
    const FrontEdge gate = gate_;
    const std::uint16_t third = found.use.third;
    if (found.attachment == kAtLastEdge) {
      escape(kPrevious);
      --tail_;
    } else {
      if (const std::uint32_t back = vertex_count_ - 1 - new_number_[third]; back < kFirstKind) {
        steps_.add(kEscape);
        out_.escapes.push_back(static_cast<std::uint8_t>(back));
      } else {
        escape(kKnown);
        known_.push_back(numberOf(third));
      }
      pushEdge({gate.a, third, gate.b});
    }
    gate_ = {third, gate.b, gate.a};
    addTriangle(found.use.triangle, gate.a, gate.b, third);
  }

  void escape(std::uint32_t kind) {
    steps_.add(kEscape);
    out_.escapes.push_back(static_cast<std::uint8_t>(kFirstKind + kind));
  }
  bool isFrontEmpty() const { return head_ == tail_; }
  void pushEdge(const FrontEdge& e) {
    front_[tail_++] = e;
    longest_front_ = std::max(longest_front_, tail_ - head_);
  }
  bool isKnown(std::uint16_t v) const { return new_number_[v] != kUnnumbered; }
  std::uint16_t numberOf(std::uint16_t v) const { return static_cast<std::uint16_t>(new_number_[v]); }
  void addVertex(std::uint16_t v, const FrontEdge& gate) {
    new_number_[v] = vertex_count_;
    out_.vertices[vertex_count_] = v;
    out_.gates[vertex_count_++] = gate;
  }
  void addTriangle(std::uint32_t t, std::uint16_t a, std::uint16_t b, std::uint16_t c) {
    is_encoded_[t] = 1;
    std::uint16_t* corner = &out_.indices[3 * std::size_t{triangle_count_}];
    corner[0] = numberOf(a), corner[1] = numberOf(b), corner[2] = numberOf(c);
    out_.triangles[triangle_count_++] = t;
  }

  const PatchGeometry& geometry_;
  std::uint32_t triangles_;
  bool careful_;  // also where a vertex has more than kMaxLooked triangles
  // Uses lie by vertex, from first_use_ on. A careful encoder drops used ones when it meets them: unused_ are left.
  std::vector<std::uint32_t> first_use_;
  std::vector<std::uint32_t> unused_;
  std::vector<TriangleUse> uses_;
  std::vector<std::uint16_t> next_;  // per use: the corner after the vertex; readable kLanes past the end
  std::vector<std::uint8_t> is_encoded_;
  std::vector<std::uint32_t> new_number_;  // per vertex
  std::vector<FrontEdge> front_;           // edges head_ … tail_ − 1; old numbers
  std::size_t head_ = 0;
  std::size_t tail_ = 0;
  std::size_t longest_front_ = 0;
  FrontEdge gate_;
  bool has_gate_ = false;
  std::uint32_t vertex_count_ = 0;    // encoded so far
  std::uint32_t triangle_count_ = 0;  // encoded so far
  StepWriter steps_;
  std::vector<std::uint16_t> known_;
  EncodedConnectivity out_;
};

}  // namespace

EncodedConnectivity encodeConnectivity(const PatchGeometry& geometry) {
  for (const bool careful : {false, true})
    if (ConnectivityEncoder encoder(geometry, careful); encoder.encode()) return encoder.takeResult();
  return {};
}

}  // namespace lod::patch::codec
