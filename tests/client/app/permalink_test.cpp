#include "client/app/permalink.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/gtc/constants.hpp>
#include <random>

namespace client {
namespace {

ViewState drawnView(unsigned seed) {
  std::mt19937 random(seed);
  const auto real = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  const auto coin = [&] { return real(0.0, 1.0) < 0.5; };
  ViewState view;
  const double scale = std::pow(10.0, real(-4.0, 7.0));
  view.position = {scale * real(-1.0, 1.0), scale * real(-1.0, 1.0), scale * real(-1.0, 1.0)};
  do view.direction = {real(-1.0, 1.0), real(-1.0, 1.0), real(-1.0, 1.0)};
  while (glm::length(view.direction) < 0.1);
  view.direction = glm::normalize(view.direction);
  view.pivot_distance = std::pow(10.0, real(-5.0, 6.0));
  if (coin()) view.fov_y = real(0.1, 2.5);
  view.method = kMethodNames[random() % kMethodNames.size()].first;
  view.statistics = coin();
  view.colors_by_resolution = coin();
  view.orthographic = coin();
  if (coin()) view.section = {true, static_cast<int>(random() % 3), coin(), scale * real(-1.0, 1.0)};
  if (coin()) view.light = {true, real(-180.0, 180.0), real(-90.0, 90.0)};
  if (view.method == Method::kHlod) view.shadows = static_cast<lod::hlod::Shadows>(random() % 3);
  return view;
}

std::string complaint(const std::string& link) {
  const auto view = parsePermalink(link);
  return view ? "" : view.error().message;
}

TEST(Permalink, aViewComesBackAsExactlyAsIsStated) {
  for (unsigned seed = 0; seed < 2000; ++seed) {
    const ViewState view = drawnView(seed);
    const std::string link = formatPermalink(view);
    ASSERT_LE(link.size(), kMaxPermalink);
    const auto back = parsePermalink(link);
    ASSERT_TRUE(bool(back)) << link << ": " << back.error().message;
    // Doubles resolve no more than 2e-16 of a coordinate.
    const double place = 1e-8 * view.pivot_distance + 3e-16 * glm::length(view.position);
    EXPECT_LE(glm::length(back->position - view.position), place) << link;
    EXPECT_LE(glm::length(back->direction - view.direction), 3e-8) << link;
    EXPECT_NEAR(glm::length(back->direction), 1.0, 1e-14);
    EXPECT_NEAR(back->pivot_distance, view.pivot_distance, 1e-8 * view.pivot_distance);
    EXPECT_NEAR(back->fov_y, view.fov_y, 1e-8);
    EXPECT_EQ(back->method, view.method);
    EXPECT_EQ(back->statistics, view.statistics);
    EXPECT_EQ(back->colors_by_resolution, view.colors_by_resolution);
    EXPECT_EQ(back->orthographic, view.orthographic);
    EXPECT_EQ(back->shadows, view.shadows);
    EXPECT_EQ(back->light.on, view.light.on);
    if (view.light.on) {
      EXPECT_NEAR(back->light.heading, view.light.heading, 0.051);
      EXPECT_NEAR(back->light.height, view.light.height, 0.051);
    }
    EXPECT_EQ(back->section.on, view.section.on);
    if (!view.section.on) continue;
    EXPECT_EQ(back->section.axis, view.section.axis);
    EXPECT_EQ(back->section.keep_below, view.section.keep_below);
    EXPECT_NEAR(back->section.offset, view.section.offset, place);
  }
}

TEST(Permalink, aLinkThatWasReadIsWrittenAsTheSameText) {
  for (unsigned seed = 0; seed < 2000; ++seed) {
    const std::string link = formatPermalink(drawnView(seed));
    EXPECT_EQ(formatPermalink(*parsePermalink(link)), link);
  }
}

TEST(Permalink, straightDownIsADirectionToo) {
  ViewState view;
  view.direction = {0.0, 0.0, -1.0};
  const std::string link = formatPermalink(view);
  EXPECT_EQ(link, "v=1&p=0,0,1&a=0,-90&r=1");
  EXPECT_LT(glm::length(parsePermalink(link)->direction - view.direction), 1e-15);
}

TEST(Permalink, theWorkedRowOfTheDocumentStays) {
  const std::string link = "v=1&p=500004.5,4000007,103.25&a=-120.5,-20&r=12.5&f=60&m=patches&o=sco&x=z,102.5,b";
  const auto view = parsePermalink("#" + link);
  ASSERT_TRUE(bool(view)) << view.error().message;
  EXPECT_EQ(view->position, glm::dvec3(500004.5, 4000007.0, 103.25));
  EXPECT_NEAR(view->direction.z, std::sin(glm::radians(-20.0)), 1e-15);
  EXPECT_EQ(view->pivot_distance, 12.5);
  EXPECT_NEAR(view->fov_y, glm::pi<double>() / 3.0, 1e-15);
  EXPECT_EQ(view->method, Method::kPatches);
  EXPECT_TRUE(view->statistics && view->colors_by_resolution && view->orthographic);
  EXPECT_EQ(view->section, (Section{true, 2, true, 102.5}));
  EXPECT_EQ(formatPermalink(*view), link);
}

TEST(Permalink, theOrderOfThePartsDoesNotMatter) {
  const auto a = parsePermalink("v=1&p=1,2,3&a=10,20&r=5");
  const auto b = parsePermalink("v=1&r=5&a=10,20&p=1,2,3");
  ASSERT_TRUE(bool(a) && bool(b));
  EXPECT_EQ(*a, *b);
}

TEST(Permalink, withoutAPlaceItLeavesTheEyeWhereItIs) {
  const auto cut = parsePermalink("v=1&x=y,-2.5,a");
  ASSERT_TRUE(cut) << cut.error().message;
  EXPECT_EQ(cut->pivot_distance, 0.0);
  EXPECT_EQ(cut->section, (Section{true, 1, false, -2.5}));
}

TEST(Permalink, badTextIsRefusedInOneLineThatNamesThePart) {
  const struct {
    const char* link;
    const char* says;
  } kCases[] = {
      {"", "v=1"},
      {"#", "v=1"},
      {"hello", "v=1"},
      {"v=2&p=1,2,3&a=0,0&r=1", "version"},
      {"v=1&p=1,2,3", "p, a or r is missing"},
      {"v=1&p=1,2,3&a=0,0", "p, a or r is missing"},
      {"v=1&r=1&x=z,1,b", "p, a or r is missing"},
      {"v=1&x=z,1", "x (section)"},
      {"v=1&p=1,2&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,3,4&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,x&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,nan&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,inf&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,1e13&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,0x10&a=0,0&r=1", "p (position)"},
      {"v=1&p=1,2,3&a=361,0&r=1", "a (direction)"},
      {"v=1&p=1,2,3&a=0,91&r=1", "a (direction)"},
      {"v=1&p=1,2,3&a=0,0&r=0", "r (distance"},
      {"v=1&p=1,2,3&a=0,0&r=-1", "r (distance"},
      {"v=1&p=1,2,3&a=0,0&r=1&f=180", "f (field"},
      {"v=1&p=1,2,3&a=0,0&r=1&m=full", "m (method)"},
      {"v=1&p=1,2,3&a=0,0&r=1&o=ss", "o (options)"},
      {"v=1&p=1,2,3&a=0,0&r=1&x=w,1,a", "x (section)"},
      {"v=1&p=1,2,3&a=0,0&r=1&x=z,1,c", "x (section)"},
      {"v=1&p=1,2,3&a=0,0&r=1&l=181,0", "l (light)"},
      {"v=1&p=1,2,3&a=0,0&r=1&l=0,91", "l (light)"},
      {"v=1&p=1,2,3&a=0,0&r=1&l=5", "l (light)"},
      {"v=1&p=1,2,3&a=0,0&r=1&m=hlod&s=mild", "s (shadows)"},
      {"v=1&p=1,2,3&a=0,0&r=1&r=2", "twice"},
      {"v=1&p=1,2,3&a=0,0&r=1&z=2", "not known"},
      {"v=1&p=1,2,3&a=0,0&r=1&", "not known"},
  };
  for (const auto& one : kCases) {
    EXPECT_NE(complaint(one.link).find(one.says), std::string::npos) << one.link << " gave: " << complaint(one.link);
    EXPECT_EQ(complaint(one.link).find('\n'), std::string::npos);
  }
  EXPECT_NE(complaint("v=1&p=" + std::string(600, '1')).find("longer"), std::string::npos);
}

TEST(Permalink, everyCutOfALinkIsRefusedOrIsAShorterLink) {
  const std::string link = formatPermalink(drawnView(7));
  for (std::size_t length = 0; length < link.size(); ++length) {
    const auto view = parsePermalink(link.substr(0, length));
    // "v=1" alone says nothing.
    EXPECT_TRUE(!view || length >= link.find("&r=") + 4 || length == 3) << link.substr(0, length);
  }
}

}  // namespace
}  // namespace client
