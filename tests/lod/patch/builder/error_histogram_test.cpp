#include "lod/patch/builder/error_histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "lod/patch/builder/distance_bound.h"

namespace {

using lod::patch::builder::errorCode;
using lod::patch::builder::ErrorHistogram;

TEST(ErrorHistogram, quantilesAreThoseOfTheAreasRoundedUp) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> exponent(-3.0F, 20.0F), area(0.0F, 100.0F);
  std::vector<std::pair<float, float>> all;
  ErrorHistogram first, second;
  double sum = 0.0;
  for (int i = 0; i < 2000; ++i) {
    all.emplace_back(std::exp2(exponent(random)), area(random));
    sum += static_cast<double>(all.back().second);
    (i % 3 == 0 ? first : second).add(errorCode(all.back().first), all.back().second);
  }
  first.add(second);
  std::sort(all.begin(), all.end());
  for (const double share : {0.1, 0.5, 0.9, 0.999, 1.0}) {
    double within = 0.0;
    float exact = 0.0F;
    for (const auto& [error, weight] : all) {
      if (within >= share * sum * (1.0 - 1e-9)) break;
      within += static_cast<double>(weight), exact = error;
    }
    EXPECT_GE(first.quantile(share), exact) << share;
    EXPECT_LE(first.quantile(share), 1.07F * exact) << share;
  }
}

TEST(ErrorHistogram, emptyIsZeroAndSmallErrorsFallIntoTheFirstBin) {
  ErrorHistogram errors;
  EXPECT_EQ(errors.quantile(0.9), 0.0F);
  errors.add(errorCode(0.0F), 3.0F);
  EXPECT_LE(errors.quantile(0.9), 1.07F / 16.0F);
  errors.add(errorCode(1e30F), 1000.0F);
  EXPECT_GE(errors.quantile(0.9), 4'194'304.0F);
  EXPECT_LE(errors.quantile(0.9), 1.07F * 4'194'304.0F);
}

TEST(ErrorHistogram, readsBackWhatItWroteAndRefusesWhatItDidNot) {
  ErrorHistogram errors;
  for (const float error : {0.5F, 3.0F, 3.0F, 900.0F}) errors.add(errorCode(error), error);
  base::ByteWriter out;
  errors.write(out);
  const base::Bytes bytes = out.takeBytes();
  ErrorHistogram again;
  base::ByteReader in(bytes);
  ASSERT_TRUE(again.read(in));
  EXPECT_TRUE(in.atEnd());
  for (const double share : {0.001, 0.5, 1.0}) EXPECT_EQ(again.quantile(share), errors.quantile(share));

  base::ByteReader cut(base::ByteView(bytes).first(bytes.size() - 1));
  EXPECT_FALSE(again.read(cut));
  const base::Bytes many(4000, 0xff);
  base::ByteReader longer(many);
  EXPECT_FALSE(again.read(longer));
}

}  // namespace
