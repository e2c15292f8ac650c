#include "server/metrics/metrics.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>

namespace server {
namespace {

TEST(Metrics, theTextIsTheExpositionFormat) {
  Metrics metrics;
  metrics.counter("b_total", "Bytes.", {{"kind", "face"}}).add(7);
  metrics.counter("b_total", "Bytes.", {{"kind", "group"}}).add();
  metrics.gauge("a_open", "Open.").set(-2);
  EXPECT_EQ(metrics.text(),
            "# HELP a_open Open.\n# TYPE a_open gauge\na_open -2\n"
            "# HELP b_total Bytes.\n# TYPE b_total counter\n"
            "b_total{kind=\"face\"} 7\nb_total{kind=\"group\"} 1\n");
}

TEST(Metrics, aHistogramCountsWhatIsAtOrBelowEachBound) {
  Metrics metrics;
  Histogram& seconds = metrics.histogram("s", "Seconds.", {0.5, 1.0}, {{"x", "y"}});
  for (const double value : {0.25, 0.5, 0.75, 4.0}) seconds.observe(value);
  EXPECT_EQ(metrics.text(),
            "# HELP s Seconds.\n# TYPE s histogram\n"
            "s_bucket{x=\"y\",le=\"0.5\"} 2\ns_bucket{x=\"y\",le=\"1\"} 3\ns_bucket{x=\"y\",le=\"+Inf\"} 4\n"
            "s_sum{x=\"y\"} 5.5\ns_count{x=\"y\"} 4\n");
}

TEST(Metrics, labelsAndHelpAreEscaped) {
  Metrics metrics;
  metrics.gauge("g", "one\\two\n\"three\"", {{"scene", "a\"b\\c\nd"}}).set(1);
  EXPECT_EQ(metrics.text(), "# HELP g one\\\\two\\n\"three\"\n# TYPE g gauge\ng{scene=\"a\\\"b\\\\c\\nd\"} 1\n");
}

TEST(Metrics, theSameNameAndLabelsAreTheSameMetric) {
  Metrics metrics;
  Counter& first = metrics.counter("n_total", "N.", {{"a", "1"}});
  EXPECT_EQ(&first, &metrics.counter("n_total", "N.", {{"a", "1"}}));
  EXPECT_NE(&first, &metrics.counter("n_total", "N.", {{"a", "2"}}));
}

TEST(Metrics, valuesFromElsewhereAreReadWhenTheTextIsMade) {
  Metrics metrics;
  double value = 0.1;
  metrics.read(Metrics::Kind::kGauge, "r", "R.", {}, [&] { return value; });
  EXPECT_EQ(metrics.text(), "# HELP r R.\n# TYPE r gauge\nr 0.1\n");
  value = std::numeric_limits<double>::infinity();
  EXPECT_EQ(metrics.text(), "# HELP r R.\n# TYPE r gauge\nr +Inf\n");
}

TEST(Metrics, commonLabelsStandBeforeTheOthers) {
  Metrics metrics;
  metrics.counter("n_total", "N.", {{"a", "1"}}).add();
  metrics.gauge("g", "G.");
  metrics.histogram("h", "H.", {1.0});
  metrics.labelAll({{"worker", "3"}});
  EXPECT_EQ(metrics.text(),
            "# HELP g G.\n# TYPE g gauge\ng{worker=\"3\"} 0\n"
            "# HELP h H.\n# TYPE h histogram\nh_bucket{worker=\"3\",le=\"1\"} 0\nh_bucket{worker=\"3\",le=\"+Inf\"} 0\n"
            "h_sum{worker=\"3\"} 0\nh_count{worker=\"3\"} 0\n"
            "# HELP n_total N.\n# TYPE n_total counter\nn_total{worker=\"3\",a=\"1\"} 1\n");
}

TEST(Metrics, threadsLoseNothing) {
  Metrics metrics;
  Counter& counter = metrics.counter("n_total", "N.");
  Histogram& histogram = metrics.histogram("h", "H.", waitingBounds());
  std::vector<std::jthread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int i = 0; i < 10'000; ++i) {
        counter.add();
        histogram.observe(1.0);
        if (i % 1000 == 0) metrics.text();
      }
    });
  threads.clear();
  EXPECT_EQ(counter.value(), 40'000U);
  EXPECT_EQ(histogram.sum(), 40'000.0);
}

TEST(MetricsDeathTest, oneNameIsOneKind) {
  Metrics metrics;
  metrics.counter("n_total", "N.");
  EXPECT_DEATH(metrics.gauge("n_total", "N."), "");
  EXPECT_DEATH(metrics.counter("no spaces", "N."), "");
}

}  // namespace
}  // namespace server
