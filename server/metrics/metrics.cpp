#include "server/metrics/metrics.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "base/check.h"

namespace server {
namespace {

bool isName(std::string_view name) {
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  return !name.empty() && is_letter(name.front()) &&
         std::all_of(name.begin(), name.end(), [&](char c) { return is_letter(c) || (c >= '0' && c <= '9'); });
}

const char* nameOf(Metrics::Kind kind) {
  switch (kind) {
    case Metrics::Kind::kCounter:
      return "counter";
    case Metrics::Kind::kGauge:
      return "gauge";
    case Metrics::Kind::kHistogram:
      return "histogram";
  }
  return "";
}

/// Backslashes and line ends with a backslash before, and quotation marks too in a label.
std::string escaped(std::string_view text, bool is_label) {
  std::string out;
  for (const char c : text) {
    if (c == '\\' || (c == '"' && is_label)) out += '\\';
    if (c == '\n')
      out += "\\n";
    else
      out += c;
  }
  return out;
}

std::string textOf(const MetricLabels& labels) {
  std::string text;
  for (const auto& [name, value] : labels) {
    LUMIGRID_CHECK(isName(name));
    if (!text.empty()) text += ',';
    text += name + "=\"" + escaped(value, true) + '"';
  }
  return text;
}

/// The shortest text that reads back as the same number.
std::string textOf(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0.0 ? "+Inf" : "-Inf";
  std::array<char, 32> text{};
  const auto done = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), done.ptr};
}

void appendSample(std::string& text, const std::string& name, const std::string& labels, const std::string& value) {
  text += name;
  if (!labels.empty()) text += '{' + labels + '}';
  text += ' ' + value + '\n';
}

/// Ranges are written as how many values are at or below each bound.
void appendHistogram(std::string& text, const std::string& name, const std::string& labels, const Histogram& values) {
  const std::string before = labels.empty() ? "" : labels + ',';
  std::uint64_t count = 0;
  for (std::size_t i = 0; i <= values.bounds().size(); ++i) {
    count += values.valuesIn(i);
    const std::string bound = i < values.bounds().size() ? textOf(values.bounds()[i]) : "+Inf";
    appendSample(text, name + "_bucket", before + "le=\"" + bound + '"', std::to_string(count));
  }
  appendSample(text, name + "_sum", labels, textOf(values.sum()));
  appendSample(text, name + "_count", labels, std::to_string(count));
}

}  // namespace

Histogram::Histogram(std::vector<double> bounds)
    : bounds_(std::move(bounds)), counts_(std::make_unique<std::atomic<std::uint64_t>[]>(bounds_.size() + 1)) {
  LUMIGRID_CHECK(std::is_sorted(bounds_.begin(), bounds_.end()));
}

void Histogram::observe(double value) {
  const auto range = std::lower_bound(bounds_.begin(), bounds_.end(), value) - bounds_.begin();
  counts_[static_cast<std::size_t>(range)].fetch_add(1, std::memory_order_relaxed);
  sum_.fetch_add(value, std::memory_order_relaxed);
}

std::vector<double> waitingBounds() {
  return {0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0};
}

Counter& Metrics::counter(const std::string& name, const std::string& help, const MetricLabels& labels) {
  const std::lock_guard lock(mutex_);
  auto& made = seriesOf(Kind::kCounter, name, help, labels).counter;
  if (!made) made = std::make_unique<Counter>();
  return *made;
}

Gauge& Metrics::gauge(const std::string& name, const std::string& help, const MetricLabels& labels) {
  const std::lock_guard lock(mutex_);
  auto& made = seriesOf(Kind::kGauge, name, help, labels).gauge;
  if (!made) made = std::make_unique<Gauge>();
  return *made;
}

Histogram& Metrics::histogram(const std::string& name, const std::string& help, const std::vector<double>& bounds,
                              const MetricLabels& labels) {
  const std::lock_guard lock(mutex_);
  auto& made = seriesOf(Kind::kHistogram, name, help, labels).histogram;
  if (!made) made = std::make_unique<Histogram>(bounds);
  return *made;
}

void Metrics::read(Kind kind, const std::string& name, const std::string& help, const MetricLabels& labels,
                   std::function<double()> value) {
  LUMIGRID_CHECK(kind != Kind::kHistogram);
  const std::lock_guard lock(mutex_);
  seriesOf(kind, name, help, labels).read = std::move(value);
}

Metrics::Series& Metrics::seriesOf(Kind kind, const std::string& name, const std::string& help,
                                   const MetricLabels& labels) {
  LUMIGRID_CHECK(isName(name));
  Family& family = families_.try_emplace(name, Family{kind, help, {}}).first->second;
  LUMIGRID_CHECK(family.kind == kind);
  return family.series[textOf(labels)];
}

void Metrics::labelAll(const MetricLabels& labels) {
  const std::lock_guard lock(mutex_);
  common_labels_ = textOf(labels);
}

std::string Metrics::text() const {
  const std::lock_guard lock(mutex_);
  std::string text;
  for (const auto& [name, family] : families_) appendFamily(text, name, family);
  return text;
}

void Metrics::appendFamily(std::string& text, const std::string& name, const Family& family) const {
  std::string samples;
  for (const auto& [own_labels, series] : family.series) {
    const bool are_both = !common_labels_.empty() && !own_labels.empty();
    const std::string labels = common_labels_ + (are_both ? "," : "") + own_labels;
    if (series.counter) appendSample(samples, name, labels, std::to_string(series.counter->value()));
    if (series.gauge) appendSample(samples, name, labels, std::to_string(series.gauge->value()));
    if (series.histogram) appendHistogram(samples, name, labels, *series.histogram);
    if (series.read) appendSample(samples, name, labels, textOf(series.read()));
  }
  if (samples.empty()) return;
  text += "# HELP " + name + ' ' + escaped(family.help, false) + "\n# TYPE " + name + ' ' + nameOf(family.kind) + '\n';
  text += samples;
}

}  // namespace server
