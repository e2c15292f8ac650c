#include "compare/report.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/file.h"
#include "base/format_text.h"
#include "compare/chart.h"

namespace compare {
namespace {

using base::formatText;

double mean(const std::vector<FrameResult>& frames, double (*get)(const FrameResult&)) {
  double sum = 0.0;
  for (const FrameResult& f : frames) sum += get(f);
  return frames.empty() ? 0.0 : sum / static_cast<double>(frames.size());
}

base::Result<void> writeText(const std::string& path, const std::string& content) {
  return base::writeFileAtomically(path, base::viewOfText(content));
}

std::string csv(const ReportContext& context, const std::vector<RunResult>& runs) {
  std::string out =
      "method,patch_tolerance_px,frame,seconds,draw_ms,bytes,bytes_images,bytes_patches,bytes_frames,triangles,images,"
      "complete,psnr_db,ssim,mean_abs,missing_share,"
      "excess_share,silhouette_px,foreground,width,height,link,renderer,machine,commit\n";
  for (const RunResult& run : runs)
    for (const FrameResult& f : run.frames) {
      out += run.method + "," + formatText("%g", run.patch_tolerance_px) + "," + std::to_string(f.frame) + "," +
             formatText("%.3f", f.seconds) + "," + formatText("%.2f", f.draw_ms) + "," + std::to_string(f.bytes) + "," +
             std::to_string(f.bytes_images) + "," + std::to_string(f.bytes_patches) + "," +
             std::to_string(f.bytes_frames) + "," + std::to_string(f.triangles) + "," + std::to_string(f.images) + "," +
             (f.complete ? "1" : "0") + "," + formatText("%.3f", f.accuracy.psnr_db) + "," +
             formatText("%.5f", f.accuracy.ssim) + "," + formatText("%.3f", f.accuracy.mean_abs) + "," +
             formatText("%.5f", f.accuracy.missing_share) + "," + formatText("%.5f", f.accuracy.excess_share) + "," +
             formatText("%.3f", f.accuracy.silhouette_px) + "," + std::to_string(f.accuracy.foreground) + "," +
             std::to_string(context.width) + "," + std::to_string(context.height) + ",\"" + context.link + "\",\"" +
             context.renderer + "\",\"" + context.machine + "\"," + context.commit + "\n";
    }
  return out;
}

Chart accuracyAgainstBytes(const std::vector<RunResult>& runs) {
  Chart chart{"Accuracy against bytes (whole path)", "bytes received, MB", "mean PSNR on foreground, dB", true, {}};
  for (const RunResult& run : runs) {
    auto it =
        std::find_if(chart.series.begin(), chart.series.end(), [&](const Series& s) { return s.name == run.method; });
    if (it == chart.series.end()) it = chart.series.insert(it, Series{run.method, {}});
    it->points.emplace_back(static_cast<double>(run.totalBytes()) / 1e6, run.meanPsnr());
  }
  for (Series& s : chart.series) std::sort(s.points.begin(), s.points.end());
  return chart;
}

Chart alongThePath(const std::vector<RunResult>& runs, const char* title, const char* label,
                   double (*get)(const FrameResult&)) {
  Chart chart{title, "frame", label, false, {}};
  for (const RunResult& run : runs) {
    Series series{run.name(), {}};
    for (const FrameResult& f : run.frames) series.points.emplace_back(f.frame, get(f));
    chart.series.push_back(std::move(series));
  }
  return chart;
}

std::string table(const std::vector<RunResult>& runs) {
  std::string out =
      "<table><tr><th>method</th><th>bytes</th><th>images</th><th>patches</th><th>exact frames</th><th>PSNR "
      "dB</th><th>SSIM</th><th>missing</th><th>draw ms (median)</th></tr>\n";
  for (const RunResult& run : runs) {
    if (run.frames.empty()) continue;
    const FrameResult& last = run.frames.back();
    auto mb = [](std::uint64_t b) { return formatText("%.2f MB", static_cast<double>(b) / 1e6); };
    out +=
        "<tr><td>" + run.name() + "</td><td>" + mb(last.bytes) + "</td><td>" + mb(last.bytes_images) + "</td><td>" +
        mb(last.bytes_patches) + "</td><td>" + mb(last.bytes_frames) + "</td><td>" +
        formatText("%.2f", run.meanPsnr()) + "</td><td>" + formatText("%.4f", run.meanSsim()) + "</td><td>" +
        formatText("%.2f %%", 100.0 * mean(run.frames, [](const FrameResult& f) { return f.accuracy.missing_share; })) +
        "</td><td>" + formatText("%.1f", run.medianDrawMs()) + "</td></tr>\n";
  }
  return out + "</table>\n";
}

// Answers, in words and figures, the questions that a reader has first.
std::string findings(const std::vector<RunResult>& runs) {
  std::string out = "<ul>\n";
  std::vector<const RunResult*> patches;
  for (const RunResult& run : runs)
    if (run.method == "patches") patches.push_back(&run);
  for (const RunResult& run : runs) {
    if (run.method.rfind("lumigraph", 0) != 0) continue;
    for (const RunResult& proxy : runs)
      if (proxy.method == "proxy" && proxy.patch_tolerance_px == run.patch_tolerance_px)
        out += "<li>" + run.name() + " is " + formatText("%+.2f", run.meanPsnr() - proxy.meanPsnr()) +
               " dB against the same proxy without images.</li>\n";
    if (!patches.empty())
      out += "<li>" + run.name() + " is " +
             formatText("%+.2f", run.meanPsnr() - psnrAtBytes(patches, static_cast<double>(run.totalBytes()))) +
             " dB against patches alone at the same bytes.</li>\n";
  }
  return out + "</ul>\n";
}

std::string page(const ReportContext& c, const std::vector<RunResult>& runs, const std::vector<Chart>& charts) {
  std::string out =
      "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Lumigrid: speed against "
      "accuracy</title>\n<style>body{font:16px/1.5 "
      "sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}table{border-collapse:collapse}td,th{padding:.2rem "
      ".7rem;border-bottom:1px solid "
      "#ccc;text-align:right}td:first-child,th:first-child{text-align:left}svg{max-width:100%}</style>\n";
  out += "<h1>Speed against accuracy</h1>\n<p>" + c.scene + ", " + std::to_string(c.width) + " × " +
         std::to_string(c.height) + ", link: " + c.link + ". Drawn by " + c.renderer + " on " + c.machine +
         ", commit " + c.commit + ". Figures are against leaf geometry, on foreground pixels only.</p>\n";
  out += findings(runs) + table(runs);
  for (const Chart& chart : charts) out += formatChart(chart);
  return out + "<p>Every figure per frame: <a href=\"results.csv\">results.csv</a></p></html>\n";
}

}  // namespace

std::string RunResult::name() const {
  return method + " (" + formatText("%g", patch_tolerance_px) + " px)";
}
double RunResult::meanPsnr() const {
  return mean(frames, [](const FrameResult& f) { return f.accuracy.psnr_db; });
}
double RunResult::meanSsim() const {
  return mean(frames, [](const FrameResult& f) { return f.accuracy.ssim; });
}
std::uint64_t RunResult::totalBytes() const {
  return frames.empty() ? 0 : frames.back().bytes;
}
double RunResult::medianDrawMs() const {
  std::vector<double> ms;
  for (const FrameResult& f : frames) ms.push_back(f.draw_ms);
  if (ms.empty()) return 0.0;
  std::nth_element(ms.begin(), ms.begin() + static_cast<std::ptrdiff_t>(ms.size() / 2), ms.end());
  return ms[ms.size() / 2];
}

double psnrAtBytes(const std::vector<const RunResult*>& runs, double bytes) {
  std::vector<std::pair<double, double>> points;
  points.reserve(runs.size());
  for (const RunResult* run : runs)
    points.emplace_back(std::log(std::max(1.0, static_cast<double>(run->totalBytes()))), run->meanPsnr());
  std::sort(points.begin(), points.end());
  if (points.empty()) return 0.0;
  const double x = std::log(std::max(1.0, bytes));
  if (x <= points.front().first) return points.front().second;
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (x > points[i].first) continue;
    const double t = (x - points[i - 1].first) / std::max(1e-12, points[i].first - points[i - 1].first);
    return points[i - 1].second + t * (points[i].second - points[i - 1].second);
  }
  return points.back().second;
}

base::Result<void> writeReport(const std::string& directory, const ReportContext& context,
                               const std::vector<RunResult>& runs) {
  LUMIGRID_TRY(base::makeDirectories(directory));
  const std::vector<Chart> charts{
      accuracyAgainstBytes(runs),
      alongThePath(runs, "Accuracy along the path", "PSNR on foreground, dB",
                   [](const FrameResult& f) { return f.accuracy.psnr_db; }),
      alongThePath(runs, "Bytes along the path", "received so far, MB",
                   [](const FrameResult& f) { return static_cast<double>(f.bytes) / 1e6; })};
  const std::array<const char*, 3> names{"accuracy_bytes.svg", "accuracy_frames.svg", "bytes_frames.svg"};
  for (std::size_t i = 0; i < charts.size(); ++i)
    LUMIGRID_TRY(writeText(directory + "/" + names[i], formatChart(charts[i])));
  LUMIGRID_TRY(writeText(directory + "/results.csv", csv(context, runs)));
  return writeText(directory + "/index.html", page(context, runs, charts));
}

}  // namespace compare
