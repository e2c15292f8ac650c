#include "compare/chart.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/format_text.h"

namespace compare {
namespace {

// The chart's sizes and margins in pixels, choices of design.
constexpr double kWidth = 860, kHeight = 520, kLeft = 70, kRight = 200, kTop = 44, kBottom = 56;
// The colours of Okabe and Ito 2008 ("Color Universal Design"), which colour-blind readers can tell apart.
constexpr std::array<const char*, 7> kColors{"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                             "#E69F00", "#56B4E9", "#000000"};

std::string number(double v) {
  return base::formatText("%.6g", v);
}

struct Axis {
  double low = 0.0, high = 1.0;
  bool logarithmic = false;
  double position(double v) const {
    const double a = logarithmic ? std::log10(low) : low;
    const double b = logarithmic ? std::log10(high) : high;
    const double x = logarithmic ? std::log10(v) : v;
    return (x - a) / (b - a);
  }
  // Ticks stand at round values: 1, 2 or 5 times a power of ten; on a logarithmic axis at 1, 2 and 5 of each decade.
  std::vector<double> ticks() const {
    std::vector<double> out;
    if (logarithmic) {
      for (double decade = std::pow(10.0, std::floor(std::log10(low))); decade <= high; decade *= 10.0)
        for (double m : {1.0, 2.0, 5.0})
          if (decade * m >= low * 0.999 && decade * m <= high * 1.001) out.push_back(decade * m);
      return out;
    }
    const double rough = (high - low) / 6.0;
    const double power = std::pow(10.0, std::floor(std::log10(rough)));
    const double step = power * (rough / power < 1.5   ? 1.0
                                 : rough / power < 3.5 ? 2.0
                                 : rough / power < 7.5 ? 5.0
                                                       : 10.0);
    for (double t = std::ceil(low / step) * step; t <= high + 1e-9 * step; t += step)
      out.push_back(std::abs(t) < 1e-9 * step ? 0.0 : t);
    return out;
  }
};

Axis fit(const Chart& chart, bool x) {
  Axis axis{std::numeric_limits<double>::max(), std::numeric_limits<double>::lowest(), x && chart.log_x};
  for (const Series& s : chart.series)
    for (const auto& [px, py] : s.points) {
      const double v = x ? px : py;
      if (!std::isfinite(v) || (axis.logarithmic && v <= 0.0)) continue;
      axis.low = std::min(axis.low, v);
      axis.high = std::max(axis.high, v);
    }
  if (axis.low > axis.high) axis.low = axis.logarithmic ? 1.0 : 0.0, axis.high = axis.low + 1.0;
  if (axis.logarithmic) {
    axis.low /= 1.15;
    axis.high *= 1.15;
  } else {
    const double pad = std::max(0.06 * (axis.high - axis.low), 1e-9 + 1e-3 * std::abs(axis.high));
    axis.low -= pad;
    axis.high += pad;
  }
  return axis;
}

struct Frame {
  Axis x, y;
  double px(double v) const { return kLeft + x.position(v) * (kWidth - kLeft - kRight); }
  double py(double v) const { return kHeight - kBottom - y.position(v) * (kHeight - kTop - kBottom); }
};

std::string text(double x, double y, const std::string& anchor, const std::string& words,
                 const std::string& more = "") {
  return "<text x=\"" + number(x) + "\" y=\"" + number(y) + "\" text-anchor=\"" + anchor + "\" " + more + ">" +
         escapeMarkup(words) + "</text>\n";
}

std::string drawAxes(const Chart& chart, const Frame& f) {
  std::string svg;
  for (double t : f.x.ticks()) {
    svg += "<line class=\"grid\" x1=\"" + number(f.px(t)) + "\" x2=\"" + number(f.px(t)) + "\" y1=\"" + number(kTop) +
           "\" y2=\"" + number(kHeight - kBottom) + "\"/>\n";
    svg += text(f.px(t), kHeight - kBottom + 18, "middle", number(t));
  }
  for (double t : f.y.ticks()) {
    svg += "<line class=\"grid\" y1=\"" + number(f.py(t)) + "\" y2=\"" + number(f.py(t)) + "\" x1=\"" + number(kLeft) +
           "\" x2=\"" + number(kWidth - kRight) + "\"/>\n";
    svg += text(kLeft - 8, f.py(t) + 4, "end", number(t));
  }
  svg += text(kLeft, 26, "start", chart.title, "font-weight=\"600\" font-size=\"16\"");
  svg += text(0.5 * (kLeft + kWidth - kRight), kHeight - 14, "middle", chart.x_label);
  const double middle = 0.5 * (kTop + kHeight - kBottom);
  svg += text(18, middle, "middle", chart.y_label, "transform=\"rotate(-90 18 " + number(middle) + ")\"");
  return svg;
}

std::string circle(double x, double y, double radius, const std::string& look) {
  return "<circle cx=\"" + number(x) + "\" cy=\"" + number(y) + "\" r=\"" + number(radius) + "\" " + look + "/>\n";
}

/// Where there are more series than colours, the colours come once more with hollow markers and dashed lines.
std::string drawSeries(const Series& s, const Frame& f, std::size_t index) {
  const std::string color = kColors[index % kColors.size()];
  const bool is_second = index >= kColors.size();
  const std::string look =
      is_second ? "fill=\"#ffffff\" stroke=\"" + color + "\" stroke-width=\"2\"" : "fill=\"" + color + "\"";
  std::string line;
  std::string markers;
  for (const auto& [x, y] : s.points) {
    if (!std::isfinite(x) || !std::isfinite(y) || (f.x.logarithmic && x <= 0.0)) continue;
    if (!line.empty()) line += " ";
    line += number(f.px(x)) + "," + number(f.py(y));
    markers += circle(f.px(x), f.py(y), 3.0, look);
  }
  const double y = kTop + 12 + 20 * static_cast<double>(index);
  std::string svg;
  if (s.is_line && line.find(' ') != std::string::npos)
    svg += "<polyline points=\"" + line + "\" fill=\"none\" stroke=\"" + color + "\" stroke-width=\"2\"" +
           (is_second ? " stroke-dasharray=\"6 3\"" : "") + "/>\n";
  return svg + markers + circle(kWidth - kRight + 18, y - 4, 5.0, look) +
         text(kWidth - kRight + 30, y, "start", s.name);
}

}  // namespace

std::string escapeMarkup(const std::string& text) {
  std::string out;
  for (char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else
      out += c;
  }
  return out;
}

std::string formatChart(const Chart& chart) {
  const Frame frame{fit(chart, true), fit(chart, false)};
  std::string svg =
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + number(kWidth) + " " + number(kHeight) +
      "\" font-family=\"sans-serif\" font-size=\"13\">\n<style>.grid{stroke:#ddd;stroke-width:1}</style>\n<rect "
      "width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n";
  svg += drawAxes(chart, frame);
  for (std::size_t i = 0; i < chart.series.size(); ++i) svg += drawSeries(chart.series[i], frame, i);
  return svg + "</svg>\n";
}

}  // namespace compare
