// Shows what the order of sending is worth: random views of which a new client has received so many bytes, in the order
// of gain per byte (plan/gain_order.h) and in others, against the full model with 4 x 4 samples a pixel.
//
//   order_bench SCENE [--views N] [--seed S] [--truth DIR] [--chart FILE.svg]
//
// All orders send the same groups and images, after the same coarse model. "reverse": what gains least first. "bytes":
// the smallest first. "in turn": groups by their errors, images as they are, whichever kind has had fewer bytes, which
// was the order before; the paper asks for both kinds at a time (Okamoto 2011, section 5.1). No group comes before
// those that it needs. It prints the mean PSNR over the views, and --chart draws it.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/gl/gl.h"
#include "base/picture_error.h"
#include "compare/chart.h"
#include "compare/sim/virtual_decoder.h"
#include "protocol/message.h"
#include "server/bake/face_encoder.h"
#include "server/trial/direct_viewer.h"
#include "tests/bench/bench.h"
#include "tests/bench/truths.h"

namespace {

using bench::must;

constexpr std::size_t kMarks[] = {100'000, 150'000, 200'000, 300'000, 450'000, 600'000, 800'000, 1'000'000, 1'500'000};

/// A message of the server's with a group or an image of a view.
struct Item {
  base::Bytes message;
  std::optional<std::uint32_t> group;  ///< else an image
};

struct Sent {
  std::vector<base::Bytes> first;  ///< Welcome and the coarse model
  std::vector<Item> items;         ///< in the server's order
  base::Bytes completion;
};

/// All that a new client is sent for a view.
Sent sentFor(const server::SceneData& data, const client::ViewerOptions& options, const base::ViewCamera& camera) {
  server::SceneData nothing_ahead = data;
  nothing_ahead.ahead_bytes = 0;
  server::Session server(nothing_ahead);
  client::Session client(options.session);
  client.connected();
  const std::vector<std::uint32_t> coarse = plan::coarseGroups(data.patches->hierarchy(), plan::kCoarseBytes);
  Sent sent;
  bool has_view = false;
  for (bool going = true; going;) {
    going = false;
    while (const auto message = client.nextToSend()) must(server.receive(*message));
    while (auto message = server.nextMessage()) {
      must(client.receive(*message));
      const client::SessionEvents events = client.takeEvents();
      const bool has_group = !events.groups_added.empty();
      if (has_group && std::find(coarse.begin(), coarse.end(), events.groups_added[0]) == coarse.end())
        sent.items.push_back({message->bytes(), events.groups_added[0]});
      else if (!events.faces_added.empty())
        sent.items.push_back({message->bytes(), {}});
      else if (client.complete())
        sent.completion = message->bytes();
      else
        sent.first.push_back(message->bytes());
      going = true;
    }
    if (!has_view && client.welcome()) client.setView(camera), has_view = going = true;
  }
  return sent;
}

/// Indices into the items: always the best next, by `isBetter`, but no group before those that it needs.
std::vector<std::size_t> orderedBy(const Sent& sent, const lod::patch::Hierarchy& hierarchy,
                                   const std::function<bool(std::size_t, std::size_t)>& isBetter) {
  std::vector<std::size_t> order, left(sent.items.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  const auto waits = [&](std::size_t i) {
    if (!sent.items[i].group) return false;
    const auto parents = hierarchy.parentsOf(*sent.items[i].group);
    return std::any_of(left.begin(), left.end(), [&](std::size_t other) {
      const auto& group = sent.items[other].group;
      return group && std::find(parents.begin(), parents.end(), *group) != parents.end();
    });
  };
  while (!left.empty()) {
    auto best = left.end();
    for (auto i = left.begin(); i != left.end(); ++i)
      if (!waits(*i) && (best == left.end() || isBetter(*i, *best))) best = i;
    order.push_back(*best);
    left.erase(best);
  }
  return order;
}

std::vector<std::size_t> inTurn(const Sent& sent, const lod::patch::Hierarchy& hierarchy) {
  std::vector<std::size_t> groups, images, order;
  for (const std::size_t i : orderedBy(sent, hierarchy, [&](std::size_t a, std::size_t b) {
         const auto errorOf = [&](std::size_t item) {
           const auto& group = sent.items[item].group;
           return group ? hierarchy.groups[*group].visible_error : 0.0F;
         };
         return errorOf(a) > errorOf(b);
       }))
    (sent.items[i].group ? groups : images).push_back(i);
  std::size_t g = 0, f = 0, of_groups = 0, of_images = 0;
  while (g < groups.size() || f < images.size()) {
    const bool is_group = f == images.size() || (g < groups.size() && of_groups <= of_images);
    order.push_back(is_group ? groups[g++] : images[f++]);
    (is_group ? of_groups : of_images) += sent.items[order.back()].message.size();
  }
  return order;
}

/// The picture of a client that has received so many bytes.
base::Image shownAfter(const Sent& sent, const std::vector<std::size_t>& order, std::size_t bytes,
                       const client::ViewerOptions& options, const base::ViewCamera& camera) {
  client::Viewer viewer(options, std::make_unique<compare::VirtualDecoder>(0.0));
  client::Session& session = viewer.session();
  session.connected();
  for (const base::Bytes& message : sent.first) {
    bytes -= std::min(bytes, message.size());
    must(session.receive(message));
  }
  session.setView(camera);
  for (const std::size_t i : order) {
    if (sent.items[i].message.size() > bytes) break;
    bytes -= sent.items[i].message.size();
    must(session.receive(sent.items[i].message));
  }
  while (session.nextToSend()) {  // Hello and View, which are answered
  }
  must(session.receive(sent.completion));

  const auto target = must(base::gl::RenderTarget::create(camera.width, camera.height));
  constexpr int kMostRounds = 10'000;
  for (int round = 0; round < kMostRounds; ++round) {
    const double now = round / 60.0;
    if (must(viewer.update(camera, now)) || !viewer.allHere()) continue;
    target.bind();
    must(viewer.draw(camera, now));
    if (viewer.stats().complete) return client::readPicture(target, viewer);
  }
  bench::stop("a view never became complete");
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, std::string(bench::kViewUsage) + " [--chart FILE.svg]");
  const bench::ViewArguments wanted = bench::viewArguments(arguments, 6);
  const std::string chart_path = arguments.text("--chart", "");
  arguments.finish();

  const auto [scene, views] = bench::openWithImages(wanted.scene, wanted.views);
  bench::Truths truths(*scene, wanted.truths);
  client::ViewerOptions options = server::settledOptions(client::Method::kLumigraph);
  options.effort->pictures = 1;  // orders are compared with each other, and this takes a sixth of the time
  const lod::patch::Hierarchy& hierarchy = scene->data.patches->hierarchy();
  const char* const names[] = {"gain per byte", "in turn", "bytes", "reverse"};
  double sums[std::size(names)][std::size(kMarks)] = {};
  double drawn = 0.0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    const base::Image truth = truths.of(views[v], wanted.views.seed, v);
    if (!server::showsModel(truth)) continue;
    const Sent sent = sentFor(scene->data, options, views[v]);
    const auto bytesOf = [&](std::size_t i) { return sent.items[i].message.size(); };
    const std::vector<std::size_t> orders[] = {
        orderedBy(sent, hierarchy, [](std::size_t a, std::size_t b) { return a < b; }), inTurn(sent, hierarchy),
        orderedBy(sent, hierarchy, [&](std::size_t a, std::size_t b) { return bytesOf(a) < bytesOf(b); }),
        orderedBy(sent, hierarchy, [](std::size_t a, std::size_t b) { return a > b; })};
    for (std::size_t o = 0; o < std::size(orders); ++o)
      for (std::size_t m = 0; m < std::size(kMarks); ++m)
        sums[o][m] += base::foregroundError(truth, shownAfter(sent, orders[o], kMarks[m], options, views[v])).psnr();
    drawn += 1.0;
    std::fprintf(stderr, "%zu of %zu views\n", v + 1, views.size());
  }

  compare::Chart chart{scene->name + ": the same bytes in other orders", "kB received", "PSNR, dB", true, {}};
  std::printf("%-14s", "kB");
  for (const std::size_t mark : kMarks) std::printf(" %6zu", mark / 1000);
  for (std::size_t o = 0; o < std::size(names); ++o) {
    std::printf("\n%-14s", names[o]);
    chart.series.push_back({names[o], {}, true});
    for (std::size_t m = 0; m < std::size(kMarks); ++m) {
      std::printf(" %6.2f", sums[o][m] / drawn);
      chart.series.back().points.emplace_back(static_cast<double>(kMarks[m]) / 1000.0, sums[o][m] / drawn);
    }
  }
  std::printf("\n");
  if (!chart_path.empty() && !(std::ofstream(chart_path) << compare::formatChart(chart)))
    bench::stop(chart_path + ": cannot be written");
  return 0;
}
