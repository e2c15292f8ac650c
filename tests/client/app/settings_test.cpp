#include "client/app/settings.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>
#include <string>

#include "lod/draw/splats.h"

namespace client {
namespace {

TEST(Settings, everyDefaultLiesInItsRangeAndEveryNameIsUsedOnce) {
  std::set<std::string_view> names;
  for (const SettingField& field : settingFields()) {
    Settings settings;
    const double standard = settings.*(field.value);
    EXPECT_TRUE(bool(setSetting(settings, field.name, standard))) << field.name;
    EXPECT_EQ(settings, Settings());
    EXPECT_TRUE(names.insert(field.name).second) << field.name;
    EXPECT_EQ(findSetting(field.name), &field);
    EXPECT_FALSE(field.label.empty());
  }
}

TEST(Settings, bothEndsOfARangeAreAllowedAndWhatIsBeyondChangesNothing) {
  for (const SettingField& field : settingFields()) {
    for (const double value : {field.min, field.max}) {
      Settings settings;
      EXPECT_TRUE(bool(setSetting(settings, field.name, value))) << field.name;
      EXPECT_EQ(settings.*(field.value), value);
    }
    for (const double value : {field.min - 1.0, field.max + 1.0, std::numeric_limits<double>::infinity(),
                               std::numeric_limits<double>::quiet_NaN()}) {
      Settings settings;
      const auto set = setSetting(settings, field.name, value);
      ASSERT_FALSE(bool(set)) << field.name << " took " << value;
      EXPECT_NE(set.error().message.find(field.name), std::string::npos);
      EXPECT_EQ(settings, Settings());
    }
  }
}

TEST(Settings, fractionsAreForNumbersOnly) {
  Settings settings;
  EXPECT_TRUE(bool(setSetting(settings, "patch_tolerance", 2.5)));
  EXPECT_FALSE(bool(setSetting(settings, "points", 2.5)));
  EXPECT_FALSE(bool(setSetting(settings, "images", 0.5)));
  EXPECT_FALSE(bool(setSetting(settings, "no_such", 1.0)));
  EXPECT_EQ(findSetting("no_such"), nullptr);
}

TEST(Settings, methodsAreThoseOfTheViewer) {
  Settings settings;
  EXPECT_EQ(methodOf(settings), Method::kLumigraph);
  const SettingField& field = *findSetting("method");
  EXPECT_EQ(field.max + 1.0, static_cast<double>(kMethodNames.size()));
  for (const auto& [method, name] : kMethodNames) {
    settings.method = *choiceValue(field, name);
    EXPECT_EQ(methodOf(settings), method);
  }
}

TEST(Settings, kernelsAreThoseOfTheRenderer) {
  const SettingField& splat = *findSetting("splat");
  EXPECT_EQ(splat.max, static_cast<double>(lod::draw::SplatKernel::kEllipse));
  for (double place = 0.0; place <= splat.max; ++place)
    EXPECT_EQ(lod::draw::splatKernelFromName(choiceName(splat, place)),
              static_cast<lod::draw::SplatKernel>(static_cast<int>(place)));
}

TEST(Settings, choicesHaveNames) {
  const SettingField& theme = *findSetting("theme");
  EXPECT_EQ(choiceName(theme, 2.0), "dark");
  EXPECT_EQ(*choiceValue(theme, "light"), 1.0);
  EXPECT_EQ(static_cast<Theme>(static_cast<int>(*choiceValue(theme, "dark"))), Theme::kDark);
  const SettingField& motion = *findSetting("reduced_motion");
  EXPECT_EQ(static_cast<ReducedMotion>(static_cast<int>(*choiceValue(motion, "on"))), ReducedMotion::kOn);
  for (const char* wrong : {"", "da", "dark ", "system light", "purple"}) EXPECT_FALSE(bool(choiceValue(theme, wrong)));
}

}  // namespace
}  // namespace client
