// Properties of the codes of spheres, normals, cones and colours, tested on many random values.
#include "lod/qsplat/node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "tests/support/decoded_splats.h"

namespace {

using namespace lod::qsplat;

class Draw {
 public:
  float unit() { return unit_(random_); }
  glm::vec3 direction() { return glm::normalize(glm::vec3(normal_(random_), normal_(random_), normal_(random_))); }
  // Returns a random sphere of any size within `parent`, which sometimes touches it.
  base::Sphere within(const base::Sphere& parent) {
    const double radius = parent.radius * (unit() < 0.2F ? std::pow(10.0, -6.0 * unit()) : static_cast<double>(unit()));
    const double away = (parent.radius - radius) * (unit() < 0.2F ? 1.0 : std::cbrt(static_cast<double>(unit())));
    base::Sphere child{glm::vec3(glm::dvec3(parent.center) + away * glm::dvec3(direction())),
                       static_cast<float>(radius)};
    // Rounding may have moved it outside; far from the origin it cannot be small at the rim.
    child.radius = std::min(child.radius, parent.radius);
    while (!encloses(parent, child)) child.center = 0.5F * (child.center + parent.center);
    return child;
  }

 private:
  std::mt19937 random_{7};
  std::uniform_real_distribution<float> unit_{0.0F, 1.0F};
  std::normal_distribution<float> normal_;
};

TEST(SphereCodes, thereAreAsManyAsThePaperSays) {
  // Counted in a second way: in floating point, as the format document describes it.
  int count = 0;
  for (int s = 1; s <= 13; ++s)
    for (int x = 0; x + s <= 13; ++x)
      for (int y = 0; y + s <= 13; ++y)
        for (int z = 0; z + s <= 13; ++z) {
          const glm::dvec3 center = (glm::dvec3(s) + 2.0 * glm::dvec3(x, y, z)) / 13.0 - 1.0;
          count += glm::length(center) <= 1.0 + std::sqrt(3.0) * s / 13.0 ? 1 : 0;
        }
  EXPECT_EQ(count, 7621);
  EXPECT_EQ(kSphereCodes, 7621U);
}

TEST(SphereCodes, areAllDifferentAndTheLastIsTheParent) {
  std::set<std::tuple<float, float, float, float>> seen;
  for (std::uint32_t code = 0; code < kSphereCodes; ++code) {
    const RelativeSphere& step = sphereTable()[code];
    seen.emplace(step.offset.x, step.offset.y, step.offset.z, step.ratio);
    if (code > 0) {
      EXPECT_LE(sphereTable()[code - 1].ratio, step.ratio);
    }
  }
  EXPECT_EQ(seen.size(), kSphereCodes);
  const base::Sphere parent{{3.0F, -5.0F, 0.25F}, 0.7F};
  const base::Sphere same = decodeSphere(parent, sphereTable()[kWholeParent]);
  EXPECT_EQ(same.center, parent.center);
  EXPECT_EQ(same.radius, parent.radius);
}

TEST(SphereCodes, everySphereWithinAParentHasOneThatEnclosesIt) {
  Draw draw;
  for (const float scale : {1e-12F, 1e-3F, 1.0F, 1e3F, 1e12F})
    for (const float offset : {0.0F, 1.0F, 1000.0F})
      for (int i = 0; i < 2000; ++i) {
        const base::Sphere parent{scale * offset * draw.direction(), scale * (0.1F + draw.unit())};
        const base::Sphere child = draw.within(parent);
        const std::uint32_t code = encodeSphere(parent, child);
        ASSERT_LT(code, kSphereCodes);
        ASSERT_TRUE(encloses(decodeSphere(parent, sphereTable()[code]), child)) << "scale " << scale;
      }
}

TEST(SphereCodes, noneOfFewerThirteenthsEncloses) {
  Draw draw;
  const base::Sphere parent{glm::vec3(0.0F), 1.0F};
  for (int i = 0; i < 300; ++i) {
    const base::Sphere child = draw.within(parent);
    const float ratio = sphereTable()[encodeSphere(parent, child)].ratio;
    for (std::uint32_t code = 0; code < kSphereCodes && sphereTable()[code].ratio < ratio; ++code)
      ASSERT_FALSE(encloses(decodeSphere(parent, sphereTable()[code]), child));
  }
}

TEST(SphereCodes, encloseDownLongChains) {
  Draw draw;
  for (int chain = 0; chain < 50; ++chain) {
    base::Sphere truth{100.0F * draw.direction(), 50.0F};
    base::Sphere decoded = truth;
    for (int level = 0; level < 127 && truth.radius > 1e-4F; ++level) {
      base::Sphere child = truth;  // now and then of its parent's size
      if (draw.unit() < 0.8F) child = draw.within(truth);
      decoded = decodeSphere(decoded, sphereTable()[encodeSphere(decoded, child)]);
      ASSERT_TRUE(encloses(decoded, child)) << "level " << level;
      truth = child;
    }
  }
}

TEST(SphereCodes, spheresOutsideTheParentBecomeTheWholeParent) {
  const float inf = std::numeric_limits<float>::infinity();
  const base::Sphere parent{glm::vec3(0.0F), 1.0F};
  for (const base::Sphere& child : {base::Sphere{{0.0F, 0.0F, 0.0F}, 2.0F}, base::Sphere{{5.0F, 0.0F, 0.0F}, 0.5F},
                                    base::Sphere{{inf, 0.0F, 0.0F}, 0.5F}, base::Sphere{{0.0F, 0.0F, 0.0F}, NAN},
                                    base::Sphere{{NAN, 0.0F, 0.0F}, 0.5F}})
    EXPECT_EQ(encodeSphere(parent, child), kWholeParent);
  EXPECT_EQ(encodeSphere({glm::vec3(0.0F), 0.0F}, {glm::vec3(0.0F), 0.0F}), kWholeParent);
}

TEST(NormalCodes, areAHundredthOfARadianOffInTheMean) {
  Draw draw;
  double sum = 0.0;
  double worst = 0.0;
  constexpr int kCount = 200000;
  for (int i = 0; i < kCount; ++i) {
    const glm::vec3 n = draw.direction();
    const glm::dvec3 decoded(normalTable()[encodeNormal(n)]);
    const double off = std::asin(std::min(1.0, glm::length(glm::cross(decoded, glm::dvec3(n)))));
    sum += off;
    worst = std::max(worst, off);
    ASSERT_GT(glm::dot(decoded, glm::dvec3(n)), 0.9);
  }
  EXPECT_GT(sum / kCount, 0.008);
  EXPECT_LT(sum / kCount, 0.012);
  EXPECT_LT(worst, 0.025);  // half the diagonal of a cell of 90/52 degrees, drawn out towards the corners
}

TEST(NormalCodes, decodeAndEncodeToThemselves) {
  for (std::uint32_t code = 0; code < kNormalCodes; ++code) {
    ASSERT_NEAR(glm::length(normalTable()[code]), 1.0F, 1e-6F);
    ASSERT_EQ(encodeNormal(normalTable()[code]), code);
    ASSERT_EQ(encodeNormal(1e-20F * normalTable()[code]), code);
  }
}

TEST(NormalCodes, invalidNormalsPointUp) {
  const std::uint32_t up = encodeNormal({0.0F, 0.0F, 1.0F});
  const float inf = std::numeric_limits<float>::infinity();
  for (const glm::vec3& n : {glm::vec3(0.0F), glm::vec3(NAN), glm::vec3(inf, 0.0F, 0.0F), glm::vec3(1.0F, NAN, 0.0F)})
    EXPECT_EQ(encodeNormal(n), up);
  EXPECT_GT(normalTable()[up].z, 0.999F);
}

TEST(ConeCodes, areTheNarrowestThatHold) {
  for (const bool leaves : {false, true}) {
    const auto encode = leaves ? encodeLeafCone : encodeCone;
    const ConeSines& sines = coneSines(!leaves);
    const std::uint32_t any = leaves ? (kLeafConeCodes - 1) : kAnyDirection;
    std::uint32_t codes = 0;
    for (int i = 0; i <= 5000; ++i) {
      const double angle = i / 5000.0 * 3.2;
      const std::uint32_t code = encode(std::cos(angle));
      ASSERT_LE(code, any);
      codes |= 1U << code;
      if (code != any) {
        EXPECT_LE(std::sin(angle), static_cast<double>(sines[code]));
        EXPECT_LT(angle, 1.6);
      }
      if (code > 0 && angle < 1.57) {
        EXPECT_GT(std::sin(angle), static_cast<double>(sines[code - 1]) * (1.0 - 1e-3));
      }
    }
    EXPECT_EQ(codes, leaves ? 0xFFFFFFFFU : 0xFU) << "each of them comes";
    EXPECT_EQ(encode(1.0), 0U);
    EXPECT_EQ(encode(1.0 + 1e-6), 0U) << "rounded up";
    EXPECT_EQ(encode(NAN), any);
    EXPECT_EQ(encode(-1.0), any);
    EXPECT_TRUE(std::isinf(sines[any]));
  }
}

TEST(ConeCodes, areReadFromTheBitsOfTheirGroup) {
  for (std::uint32_t code = 0; code < kLeafConeCodes; ++code) {
    const Node leaf{packLeaf(7000, 16000, code), 0};
    EXPECT_EQ(leaf.sphereCode(), 7000U);
    EXPECT_EQ(leaf.normalCode(), 16000U);
    EXPECT_TRUE(leaf.hasCodes());
    EXPECT_EQ(leaf.coneField(), code);
    if (code < (kLeafConeCodes - 1)) {
      EXPECT_EQ(coneSines(false)[leaf.coneField()], static_cast<float>(code + 1) / 32.0F);
    }
    for (const std::uint32_t children : {0U, 2U, 3U, 4U}) {
      const Node node{packNode(7000, 16000, code % 4, children, children == 3), 0};
      EXPECT_EQ(coneSines(true)[node.coneField()], coneSines(true)[code % 4]);
    }
  }
}

TEST(ColorCodes, keepTheirValueAndTakeTheNearest) {
  for (std::uint32_t code = 0; code < 65536; ++code)
    ASSERT_EQ(encodeColor(support::decodeColor(static_cast<std::uint16_t>(code))), code);
  for (int v = 0; v < 256; ++v) {
    const glm::u8vec3 decoded = support::decodeColor(encodeColor(glm::u8vec3(static_cast<std::uint8_t>(v))));
    EXPECT_LE(std::abs(decoded.r - v), 4);
    EXPECT_LE(std::abs(decoded.g - v), 2);
    EXPECT_LE(std::abs(decoded.b - v), 4);
  }
}

TEST(NodeBits, holdEveryField) {
  for (const std::uint32_t children : {0U, 2U, 3U, 4U}) {
    const Node node{packNode(7000, 16000, 2, children, children != 0), 0};
    EXPECT_EQ(node.sphereCode(), 7000U);
    EXPECT_EQ(node.normalCode(), 16000U);
    EXPECT_EQ(node.coneCode(), 2U);
    EXPECT_EQ(node.children(), children);
    EXPECT_EQ(node.isLeaf(), children == 0);
    EXPECT_EQ(node.childrenAreLeaves(), children != 0);
    EXPECT_TRUE(node.valid());
  }
  EXPECT_FALSE((Node{packNode(kSphereCodes, 0, 0, 0, false), 0}.valid()));
  EXPECT_FALSE((Node{packNode(0, kNormalCodes, 0, 0, false), 0}.valid()));
  EXPECT_FALSE((Node{packNode(0, 0, 0, 0, true), 0}.valid()));
}

}  // namespace
