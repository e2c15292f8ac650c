#pragma once
// Numbers that a running server tells of itself, and the text in which Prometheus reads them (exposition format 0.0.4,
// https://prometheus.io/docs/instrumenting/exposition_formats/). Threads update them without locks; making the text
// takes one.
#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace server {

/// Only grows.
class Counter {
 public:
  void add(std::uint64_t amount = 1) { value_.fetch_add(amount, std::memory_order_relaxed); }
  std::uint64_t value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::uint64_t> value_ = 0;
};

/// Goes up and down.
class Gauge {
 public:
  void add(std::int64_t amount) { value_.fetch_add(amount, std::memory_order_relaxed); }
  void set(std::int64_t value) { value_.store(value, std::memory_order_relaxed); }
  std::int64_t value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::int64_t> value_ = 0;
};

/// Counts values in fixed ranges.
class Histogram {
 public:
  /// `bounds`: upper bounds of the ranges, which include them, in ascending order; what is above all has a range too.
  explicit Histogram(std::vector<double> bounds);
  void observe(double value);

  const std::vector<double>& bounds() const { return bounds_; }
  /// Values in range `i`, 0 to bounds().size().
  std::uint64_t valuesIn(std::size_t i) const { return counts_[i].load(std::memory_order_relaxed); }
  double sum() const { return sum_.load(std::memory_order_relaxed); }

 private:
  const std::vector<double> bounds_;
  const std::unique_ptr<std::atomic<std::uint64_t>[]> counts_;
  std::atomic<double> sum_ = 0.0;
};

/// Bounds in seconds from half a millisecond to ten seconds: of what a viewer waits for.
std::vector<double> waitingBounds();

/// Names and values; the values may be any text.
using MetricLabels = std::vector<std::pair<std::string, std::string>>;

class Metrics {
 public:
  static constexpr const char* kContentType = "text/plain; version=0.0.4; charset=utf-8";

  /// The metric of this name and these labels, made when it is asked for first; it lives as long as this. Names are
  /// those of Prometheus (letters, digits, '_'), counters' end with _total, units are seconds and bytes. `help`: one
  /// sentence, the same for all labels. To ask for one name as two kinds is a caller's mistake.
  Counter& counter(const std::string& name, const std::string& help, const MetricLabels& labels = {});
  Gauge& gauge(const std::string& name, const std::string& help, const MetricLabels& labels = {});
  Histogram& histogram(const std::string& name, const std::string& help, const std::vector<double>& bounds,
                       const MetricLabels& labels = {});

  enum class Kind { kCounter, kGauge, kHistogram };
  /// A value that is known elsewhere: `read` is asked for it whenever the text is made, by the thread that makes it.
  /// It must be good as long as text() is called. Asked again with the same name and labels, the newer one counts.
  void read(Kind kind, const std::string& name, const std::string& help, const MetricLabels& labels,
            std::function<double()> value);

  /// Puts these before the labels of every metric.
  void labelAll(const MetricLabels& labels);
  /// All metrics, by name and labels in alphabetical order.
  std::string text() const;

 private:
  struct Series {
    std::unique_ptr<Counter> counter;
    std::unique_ptr<Gauge> gauge;
    std::unique_ptr<Histogram> histogram;
    std::function<double()> read;
  };
  struct Family {
    Kind kind = Kind::kCounter;
    std::string help;
    std::map<std::string, Series> series;  // by labels as they are written, without braces
  };
  Series& seriesOf(Kind kind, const std::string& name, const std::string& help, const MetricLabels& labels);
  void appendFamily(std::string& text, const std::string& name, const Family& family) const;

  mutable std::mutex mutex_;
  std::map<std::string, Family> families_;
  std::string common_labels_;  // as they are written
};

}  // namespace server
