#include "compare/sim/page.h"

#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <utility>

#include "base/format_text.h"
#include "compare/chart.h"
#include "compare/sim/equal_bytes.h"

namespace compare {
namespace {

using base::formatText;
using Runs = std::vector<const PlayedRun*>;

constexpr const char* kStyle = R"(<style>
:root{color-scheme:light dark;--line:#8884;--soft:#8881}
body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}
.scroll{overflow-x:auto}
table{border-collapse:collapse;white-space:nowrap;font-variant-numeric:tabular-nums}
td,th{padding:.2rem .6rem;border-bottom:1px solid var(--line);text-align:right}
td:first-child,th:first-child{text-align:left}
th{cursor:pointer;white-space:normal;vertical-align:bottom;line-height:1.2}
th:hover{background:var(--soft)}
svg{display:block;width:100%;height:auto;border-radius:6px}
.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,30rem),1fr));gap:1rem;margin:1rem 0}
.frames{display:grid;grid-template-columns:repeat(auto-fill,minmax(15rem,1fr));gap:1rem}
figure{margin:0}
figcaption{font-size:.85rem}
img{width:100%;cursor:zoom-in;border-radius:4px}
img.large{position:fixed;inset:0;width:100vw;height:100vh;object-fit:contain;background:#000d;cursor:zoom-out}
@media(max-width:40rem){body{margin:1rem auto;font-size:15px}}
</style>
)";

constexpr const char* kScript = R"(<script>
for(const table of document.querySelectorAll("table"))
  table.tHead.addEventListener("click",({target})=>{
    const column=target.cellIndex,rows=[...table.tBodies[0].rows];
    const down=target.dataset.down!=="1";
    target.dataset.down=down?"1":"0";
    const value=row=>{const text=row.cells[column].textContent;return text===""?NaN:isNaN(text)?text:Number(text)};
    rows.sort((a,b)=>{const x=value(a),y=value(b);
      if(Number.isNaN(x))return 1;
      if(Number.isNaN(y))return -1;
      return (x<y?-1:x>y?1:0)*(down?-1:1)});
    table.tBodies[0].append(...rows)});
document.addEventListener("click",({target})=>{if(target.tagName==="IMG")target.classList.toggle("large")});
</script>
)";

std::string base64(base::ByteView bytes) {
  std::string text(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int length =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()), bytes.data(), static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  return text;
}

std::string nameOfRun(const PlayedRun& run, bool sweeps) {
  return sweeps ? run.setting.method + formatText(" %g", run.setting.knob) : run.setting.method;
}

double megabytes(const PlayedRun& run) {
  return static_cast<double>(run.frames.back().counts.bytes) / 1e6;
}

/// The runs by a text that they share, in the order in which the texts first come.
template <class TextOf>
std::vector<std::pair<std::string, Runs>> grouped(const Runs& runs, const TextOf& textOf) {
  std::vector<std::pair<std::string, Runs>> groups;
  for (const PlayedRun* run : runs) {
    const std::string text = textOf(*run);
    auto it = std::find_if(groups.begin(), groups.end(), [&](const auto& group) { return group.first == text; });
    if (it == groups.end()) it = groups.insert(it, {text, {}});
    it->second.push_back(run);
  }
  return groups;
}

/// Mean accuracy at the moment of display against all bytes: a line for each method, a point for each value of its
/// knob.
Chart chartOfBytes(const std::string& title, const Runs& runs) {
  Chart chart{title, "bytes of the whole run, MB", "mean PSNR at the moment of display, dB", true, {}};
  for (const auto& [method, of_method] : grouped(runs, [](const PlayedRun& run) { return run.setting.method; })) {
    Series& series = chart.series.emplace_back(Series{method, {}});
    for (const PlayedRun* run : of_method) series.points.emplace_back(megabytes(*run), run->meanPsnr());
  }
  for (Series& series : chart.series) std::sort(series.points.begin(), series.points.end());
  return chart;
}

/// Each method's run with its default knob, or its first one where that was not played.
Runs withDefaultKnobs(const Runs& runs) {
  Runs chosen;
  for (const PlayedRun* run : runs) {
    const auto of_method = [&](const PlayedRun* other) { return other->setting.method == run->setting.method; };
    const auto there = std::find_if(chosen.begin(), chosen.end(), of_method);
    if (there == chosen.end())
      chosen.push_back(run);
    else if (std::vector{run->setting.knob} == knobsOf(run->setting.method, false))
      *there = run;
  }
  return chosen;
}

/// A figure of each frame against time, a line for each run.
Chart chartAlong(const std::string& title, const std::string& label, const Runs& runs,
                 double (*figure)(const DisplayedFrame&)) {
  Chart chart{title, "seconds since the client began to connect", label, false, {}};
  for (const PlayedRun* run : runs) {
    Series series{run->setting.method, {}};
    for (const DisplayedFrame& frame : run->frames)
      if (frame.kind != InstantKind::kRest) series.points.emplace_back(frame.seconds, figure(frame));
    chart.series.push_back(std::move(series));
  }
  return chart;
}

struct NamedChart {
  const char* name;
  Chart chart;
};

/// The charts of one scene, path and link.
std::vector<NamedChart> chartsOf(const std::string& title, const Runs& runs) {
  const Runs normal = withDefaultKnobs(runs);
  const auto psnr = [](const DisplayedFrame& f) { return f.accuracy.psnr_db; };
  const auto arrived = [](const DisplayedFrame& f) { return static_cast<double>(f.counts.bytes) / 1e6; };
  const auto drawn = [](const DisplayedFrame& f) { return f.draw_wall_ms; };
  return {{"bytes", chartOfBytes(title, runs)},
          {"accuracy", chartAlong(title, "PSNR at that moment, dB", normal, psnr)},
          {"arrived", chartAlong(title, "bytes arrived by then, MB", normal, arrived)},
          {"draw_wall", chartAlong(title, "time to draw on the machine that measured, ms", normal, drawn)}};
}

Runs pointersTo(const std::vector<PlayedRun>& runs) {
  Runs all;
  for (const PlayedRun& run : runs) all.push_back(&run);
  return all;
}

std::string titleOf(const PlayedRun& run) {
  return run.scene + ", " + run.path + ", " + run.link;
}

std::string cell(double value, const char* format, bool there = true) {
  return there ? "<td>" + formatText(format, value) + "</td>" : "<td></td>";
}

/// Whether no other run is at least as near to the truth with at most as many bytes.
bool onFront(const PlayedRun& run, const Runs& runs) {
  return std::none_of(runs.begin(), runs.end(), [&](const PlayedRun* other) {
    const bool as_good = other->meanPsnr() >= run.meanPsnr() && megabytes(*other) <= megabytes(run);
    return as_good && (other->meanPsnr() > run.meanPsnr() || megabytes(*other) < megabytes(run));
  });
}

std::string tableOf(const Runs& runs) {
  std::string out = "<div class=\"scroll\"><table><thead><tr>";
  for (const char* name : {"method", "knob", "front", "dB, mean", "dB, 5th percentile", "SSIM", "holes %",
                           "silhouette px, 95 %", "flicker", "flickering pixels %", "MB", "requests", "s to a picture",
                           "s to 25 dB", "s to 30 dB", "s to 35 dB", "s to rest", "dB at rest"})
    out += std::string("<th>") + name + "</th>";
  out += "</tr></thead><tbody>\n";
  for (const PlayedRun* run : runs) {
    const DisplayedFrame& last = run->frames.back();
    out += "<tr><td>" + escapeMarkup(run->setting.method) + "</td>" + cell(run->setting.knob, "%g") +
           (onFront(*run, runs) ? "<td>●</td>" : "<td></td>") + cell(run->meanPsnr(), "%.2f") +
           cell(run->p5Psnr(), "%.2f") + cell(run->meanSsim(), "%.3f") + cell(100.0 * run->meanMissing(), "%.2f") +
           cell(run->p95Silhouette(), "%.1f") + cell(run->meanFlicker().mean, "%.2f") +
           cell(100.0 * run->meanFlicker().share, "%.2f") + cell(megabytes(*run), "%.2f") +
           cell(static_cast<double>(last.counts.requests), "%.0f");
    for (const double seconds :
         {run->secondsToFirst(), run->secondsTo(25.0), run->secondsTo(30.0), run->secondsTo(35.0), run->rest_seconds})
      out += cell(seconds, "%.2f", seconds >= 0.0);
    out += cell(last.accuracy.psnr_db, "%.2f", last.kind == InstantKind::kRest) + "</tr>\n";
  }
  return out + "</tbody></table></div>\n";
}

std::string figureOf(const std::string& caption, const base::Bytes& jpeg) {
  return "<figure><img alt=\"" + escapeMarkup(caption) + "\" src=\"data:image/jpeg;base64," + base64(jpeg) +
         "\"><figcaption>" + escapeMarkup(caption) + "</figcaption></figure>\n";
}

/// The first method's default beside what others show for its bytes, where their knobs were swept.
std::string equalBytesOf(const Runs& runs) {
  const std::string& first = runs.front()->setting.method;
  const auto normal = std::find_if(runs.begin(), runs.end(), [&](const PlayedRun* run) {
    return run->setting.method == first && std::vector{run->setting.knob} == knobsOf(first, false);
  });
  const PlayedRun& reference = normal == runs.end() ? *runs.front() : **normal;
  const std::vector<BytesDifference> differences = differencesAtBytesOf(reference, runs);
  if (differences.empty()) return "";
  std::string out = "<p>At the bytes of " + escapeMarkup(nameOfRun(reference, true)) + ", its lead over ";
  for (std::size_t i = 0; i < differences.size(); ++i)
    out += (i == 0 ? "" : ", ") + escapeMarkup(differences[i].method) +
           formatText(" is %.2f ± %.2f dB", differences[i].db, differences[i].confidence);
  return out + " (95 % confidence over the judged frames).</p>\n";
}

/// A picture of a run that the page shows.
struct Shot {
  const PlayedRun* run;
  const DisplayedFrame* frame;
};

/// The worst of all pictures of a method, and the median of its runs' medians.
std::array<Shot, 2> worstAndMedian(const std::vector<Shot>& shots) {
  const auto worse = [](const Shot& a, const Shot& b) { return a.frame->accuracy.psnr_db < b.frame->accuracy.psnr_db; };
  std::vector<Shot> medians;  // each run's better one, since a run keeps its worst and its median
  for (const Shot& shot : shots) {
    if (medians.empty() || medians.back().run != shot.run) medians.push_back(shot);
    if (worse(medians.back(), shot)) medians.back() = shot;
  }
  std::stable_sort(medians.begin(), medians.end(), worse);
  return {*std::min_element(shots.begin(), shots.end(), worse), medians[medians.size() / 2]};
}

/// The worst and the median picture of each method in all runs of a scene, each with its difference from the truth.
std::string picturesOf(const Runs& runs) {
  std::string out;
  for (const auto& [method, of_method] : grouped(runs, [](const PlayedRun& run) { return run.setting.method; })) {
    std::vector<Shot> shots;
    for (const PlayedRun* run : of_method)
      for (const DisplayedFrame* frame : run->moving())
        if (!frame->picture_jpeg.empty()) shots.push_back({run, frame});
    if (shots.empty()) continue;
    const auto [worst, median] = worstAndMedian(shots);
    for (const auto& [word, shot] : {std::pair{"worst", worst}, {"median", median}}) {
      const std::string caption =
          method + ", " + word +
          formatText(": %.1f dB at %.2f s, ", shot.frame->accuracy.psnr_db, shot.frame->seconds) + shot.run->path +
          ", " + shot.run->link;
      out += figureOf(caption, shot.frame->picture_jpeg);
      out += figureOf(caption + ", error × 4", shot.frame->difference_jpeg);
    }
  }
  return out.empty() ? "" : "<div class=\"frames\">\n" + out + "</div>\n";
}

std::string costsOf(const SceneCosts& costs) {
  std::string out = "<h2>" + escapeMarkup(costs.scene) +
                    ", what it took</h2>\n<div class=\"scroll\"><table><thead><tr>" +
                    "<th>part</th><th>MB on disk</th><th>s to build</th></tr></thead><tbody>\n";
  for (const PartCosts& part : costs.parts)
    out += "<tr><td>" + escapeMarkup(part.name) + "</td>" + cell(static_cast<double>(part.bytes) / 1e6, "%.2f") +
           cell(part.build_seconds, "%.1f", part.build_seconds >= 0.0) + "</tr>\n";
  out += "</tbody></table></div>\n";
  if (costs.peak_memory_bytes > 0.0)
    out += formatText("<p>The builds took %.0f MB of memory at most.</p>\n", costs.peak_memory_bytes / 1e6);
  return out;
}

/// The result of one scene, path and link in a sentence: who was nearest to the truth while moving, and at what cost.
std::string finding(const Runs& runs) {
  const PlayedRun* best = *std::max_element(
      runs.begin(), runs.end(), [](const PlayedRun* a, const PlayedRun* b) { return a->meanPsnr() < b->meanPsnr(); });
  const PlayedRun* least = *std::min_element(
      runs.begin(), runs.end(), [](const PlayedRun* a, const PlayedRun* b) { return megabytes(*a) < megabytes(*b); });
  std::string out = "<p>Nearest to the truth at the moment of display: <b>" + escapeMarkup(nameOfRun(*best, true)) +
                    "</b>, " + formatText("%.1f dB in %.2f MB", best->meanPsnr(), megabytes(*best));
  if (least != best)
    out += ". Fewest bytes: <b>" + escapeMarkup(nameOfRun(*least, true)) + "</b>, " +
           formatText("%.1f dB in %.2f MB", least->meanPsnr(), megabytes(*least));
  return out + ".</p>\n";
}

}  // namespace

std::string formatPage(const PageContext& c, const std::vector<PlayedRun>& runs) {
  std::string out =
      "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width\"><title>Speed against accuracy</title>\n";
  out += kStyle;
  out +=
      "<h1>Speed against accuracy</h1>\n<p>In virtual time: server, link and client are simulated, so another machine "
      "shows the same figures. PSNR is that of what the display shows at a moment against the full model seen from "
      "where the viewer is at that moment, on pixels of the model only. A dot in the column front: no other run is "
      "nearer with as few bytes.</p>\n";
  for (const auto& [scene, of_scene] : grouped(pointersTo(runs), [](const PlayedRun& run) { return run.scene; })) {
    for (const auto& [title, section] : grouped(of_scene, titleOf)) {
      out += "<h2>" + escapeMarkup(title) + "</h2>\n" + finding(section) + equalBytesOf(section) + tableOf(section);
      out += "<div class=\"charts\">\n";
      for (const NamedChart& one : chartsOf(title, section)) out += formatChart(one.chart);
      out += "</div>\n";
    }
    if (const std::string pictures = picturesOf(of_scene); !pictures.empty())
      out += "<h2>" + escapeMarkup(scene) + ", the worst and the median picture of each method</h2>\n" + pictures;
    for (const SceneCosts& costs : c.scenes)
      if (costs.scene == scene) out += costsOf(costs);
  }
  out +=
      "<h2>How it was measured</h2>\n<p>" + escapeMarkup(c.command) + "</p>\n<p>Commit " + escapeMarkup(c.commit) +
      ", drawn by " + escapeMarkup(c.renderer) + " on " + escapeMarkup(c.machine) +
      formatText(
          ". Seed %llu, %d instants a run, a display of %g Hz. Costs: %g ms an exact frame, %g ms a JPEG of "
          "512 x 512, %g ms a frame of the client.",
          static_cast<unsigned long long>(c.play.seed), c.play.instants, c.play.display_hertz,
          1e3 * c.costs.server_render_seconds, 1e3 * c.costs.client_decode_seconds, 1e3 * c.costs.client_draw_seconds) +
      " Every figure: results.csv, summary.csv.</p>\n";
  return out + kScript + "</html>\n";
}

std::vector<ChartFile> chartFiles(const std::vector<PlayedRun>& runs) {
  std::vector<ChartFile> files;
  for (const auto& [title, section] : grouped(pointersTo(runs), titleOf)) {
    const PlayedRun& first = *section.front();
    for (const NamedChart& one : chartsOf(title, section))
      files.push_back({fileNameOf({first.scene, first.path, first.link, one.name}) + ".svg", formatChart(one.chart)});
  }
  return files;
}

}  // namespace compare
