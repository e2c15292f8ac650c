// lumigrid-view is the thin client, in a window or headless.
#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>

#include "base/format_text.h"
#include "base/json/camera_file.h"
#include "client/app/permalink.h"
#include "client/app/streamed_settings.h"
#include "client/native/headless.h"
#include "client/native/host_access.h"
#include "client/native/host_probe.h"
#include "client/native/local_scene.h"
#include "client/native/units.h"
#include "client/native/user_files.h"
#include "client/native/window.h"
#include "lod/hlod/shadow_options.h"

namespace {

constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;

/// The command line as typed: values with units and choices are still text, all others are in `run` and `window`.
struct Arguments {
  client::HeadlessOptions run;   ///< a window takes its URL, viewer, streamed options, link and threads from here
  client::WindowOptions window;  ///< what only a window has
  bool headless = false;
  std::string path_file;
  std::string size;
  std::string method = "lumigraph";
  std::string splat = "circle";
  double frame_rate = 10.0;
  std::string colors = "surface";
  std::string light;
  lod::hlod::ShadowArguments shadows;
  std::string order = "sweeps";
  std::string idle = "16M";
  std::string cache = "50M";
  bool antialias = true;
  std::string gpu_memory = "512M";
  std::string memory = "1G";
  std::string bandwidth;
  std::string latency;
  std::string token;
  std::string token_file;
  std::string background = "transparent";
  bool use_settings = true;
  bool json = false;
  bool check_host = false;
};

std::atomic<bool> interrupted{false};

void onSignal(int) {
  interrupted = true;
}

void endOnSignals() {
  std::signal(SIGINT, onSignal);
  std::signal(SIGTERM, onSignal);
  std::signal(SIGPIPE, SIG_IGN);  // whoever reads the lines may go away; the pictures matter more
}

int printError(const std::string& message, int status) {
  std::fprintf(stderr, "lumigrid-view: %s\n", message.c_str());
  return status;
}

void addContentOptions(CLI::App& app, Arguments& a) {
  app.option_defaults()->group("Display");
  app.add_option("--method", a.method,
                 "lumigraph: patches textured by images; patches: the patches alone; qsplat: splats, streamed from the "
                 "scene's qsplat.lgq in the order in which the view has use for them; pmr: points and umbrella "
                 "triangles, streamed from its pmr.lgm; hlod: triangles and points, streamed from its hlod.lgh. Where "
                 "it is left out, a scene of one of these only is shown as "
                 "such")
      ->check(CLI::IsMember({"lumigraph", "patches", "qsplat", "pmr", "hlod"}));
  app.add_flag("--images,!--no-images", a.run.viewer.session.images,
               "Use images of the repository (on unless --no-images)");
  app.add_flag("--frames,!--no-frames", a.run.viewer.session.frames,
               "Ask for the exact picture of the view (on unless --no-frames)");
  app.add_flag(
      "--refine,!--no-refine", a.run.viewer.session.refine,
      "Refine a view at rest: where the server draws it, the last picture comes without loss, for about three times "
      "its bytes; else patches are refined, for 1.2 to 1.8 times the data (on unless --no-refine)");
  app.add_flag(
      "--antialias,!--no-antialias", a.antialias,
      "Average four samples a pixel, eight at rest, where --memory, the GL and the time of a frame allow it (on "
      "unless --no-antialias)");
  app.add_option(
         "--colors", a.colors,
         "surface: the model's own; resolution: tinted by the view pixels that the detail spans, blue up to one, "
         "red above eight; disagreement: by how many times their expected error images differ from each "
         "other")
      ->check(CLI::IsMember({"surface", "resolution", "disagreement"}));
  app.add_option("--light", a.light,
                 "HEADING,HEIGHT in degrees: the model's own colours by a light from there, in place of the scene's. "
                 "HEADING: -180 to 180, from x towards y; HEIGHT: -90 to 90 above the plane of x and y");
  app.add_option("--fps", a.run.viewer.fps,
                 "Pictures a second of patches and images while the view moves: fewer samples a pixel, pixels and "
                 "images until they come so fast. 0: as fine as at rest")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--points", a.run.viewer.session.max_points, "Sampling points whose images are asked for, 1 to 64")
      ->check(CLI::Range(1, 64));
  app.add_option("--samples", a.run.viewer.lumigraph.max_samples,
                 "Images blended in a picture, 1 to 32; four tiles of a face count as one")
      ->check(CLI::Range(1, 32));
  const client::SessionOptions& session = a.run.viewer.session;
  app.add_option_function<float>(
         "--patch-tolerance", [&a](float px) { a.run.viewer.session.setPatchTolerance(px); },
         base::formatText("Patches are refined until their error is at most this, in pixels (default: %g, and %g where "
                          "no images are used)",
                          static_cast<double>(session.patch_tolerance_px),
                          static_cast<double>(session.alone_tolerance_px)))
      ->check(CLI::Range(0.0, 1000.0));
  app.add_flag(
      "--guarantee,!--no-guarantee", a.run.viewer.session.guarantee,
      "Keep --patch-tolerance by the proved bound of the error, not by what is seen of it: many times the data");
  app.add_option("--max-triangles", a.run.viewer.session.max_triangles,
                 "Refinement stops at this many triangles; at four times as many in a view at rest")
      ->check(CLI::Range(1'000, 1'000'000'000));
}

void addStreamedOptions(CLI::App& app, Arguments& a) {
  app.option_defaults()->group("Display");
  app.add_option("--splat", a.splat,
                 "Kernel of --method qsplat. square: the fastest; circle; fuzzy: softly blended; ellipse: lies in the "
                 "surface, the sharpest, with a hole now and then")
      ->check(CLI::IsMember({"square", "circle", "fuzzy", "ellipse"}));
  app.add_option("--cutoff", a.run.streamed.cutoff_px,
                 "Splats are refined down to this diameter, in pixels, when the view rests; 0: down to the leaves")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--tolerance", a.run.streamed.tolerance,
                 "Umbrellas of --method pmr have about this radius, in pixels, when the view rests; above 1, sparser "
                 "ones are drawn where points do not show that")
      ->check(CLI::Range(static_cast<double>(client::kMinTolerance), 1000.0));
  app.add_option("--error-px", a.run.streamed.error_px,
                 "Triangles and points of --method hlod have at most this error on the screen, in pixels, when the "
                 "view rests")
      ->check(CLI::Range(static_cast<double>(client::kMinErrorPx), 1000.0));
  app.add_option("--frame-rate", a.frame_rate,
                 "Pictures a second with --method qsplat, pmr or hlod while the view moves: splats, umbrellas and "
                 "errors get as large as that asks for. 0: as fine as at rest")
      ->check(CLI::Range(0.0, 1000.0));
  lod::hlod::declareShadowOptions(app, a.shadows);
  app.add_option("--order", a.order,
                 "In which order splats come. sweeps: from the top down, each time twice as fine; level: by level of "
                 "the tree; radius: the largest of the scene first; size: the largest in the picture first; rows: from "
                 "the top down, each at its finest")
      ->check(CLI::IsMember({"sweeps", "level", "radius", "size", "rows"}));
  app.add_flag("--back-faces", a.run.streamed.back_faces,
               "Draw splats that turn their backs, too (default: leave them out); for open surfaces that are seen from "
               "behind");
  app.add_option(
         "--idle", a.idle,
         "Splats, or triangles and points, fetched ahead once the view has all that it needs, for each view, in "
         "bytes; 0: none")
      ->group("Limits");
}

void addPictureOptions(CLI::App& app, Arguments& a) {
  app.option_defaults()->group("Display");
  app.add_option(
      "--background", a.background,
      "#rrggbb, #rrggbbaa, transparent, or scene: the one that the scene has, which a window takes by itself");
  app.add_option("--size", a.size,
                 "Window size (default: 1280x720); headless: size of all pictures, whatever the path says");
}

void addLimitOptions(CLI::App& app, Arguments& a) {
  app.option_defaults()->group("Limits");
  app.add_option("--cache", a.cache, "Images and patches kept as they came, in bytes: 50M, 1G");
  app.add_option("--memory", a.memory, "All that grows with the scene, on the GPU and off, in bytes; at least 16M");
  app.add_option("--gpu-memory", a.gpu_memory, "Images kept on the GPU, in bytes");
  app.add_option("--threads", a.run.decoder_threads, "Threads that decode images")->check(CLI::Range(1, 64));
  app.add_option("--bandwidth", a.bandwidth,
                 "Emulate a link of this rate, such as 20Mbit (default: as fast as it comes)");
  app.add_option(
      "--latency", a.latency,
      "Delay that the emulated link adds to each message towards the viewer, so once per round trip, such as "
      "30ms (default: none)");
  app.add_option("--connect-timeout", a.run.connect_timeout, "Headless: seconds without the server before giving up")
      ->check(CLI::Range(0.1, 3600.0));
}

void addAccessOptions(CLI::App& app, Arguments& a) {
  app.option_defaults()->group("Private scenes");
  CLI::Option* token = app.add_option("--token", a.token,
                                      "Token that opens a private scene. Other users of this machine see it in the "
                                      "list of processes; --token-file and LUMIGRID_TOKEN keep it from them");
  app.add_option(
         "--token-file", a.token_file,
         "File that holds the token; without it the environment's LUMIGRID_TOKEN counts. A signed link needs neither")
      ->excludes(token);
  app.add_option("--ca", a.run.access.ca_file,
                 "Certificates (PEM) of authorities that are trusted besides those of this system")
      ->check(CLI::ExistingFile);
}

void addRunOptions(CLI::App& app, Arguments& a) {
  app.add_flag("--check-host", a.check_host,
               "Say whether the host of a published scene does all that viewers need, and what to change; no pictures")
      ->group("Published scenes");
  app.option_defaults()->group("Headless");
  app.add_flag("--headless", a.headless, "No window: pictures of --path, or without it one of the first view");
  app.add_option("--path", a.path_file, "Camera path to follow, a JSON file (docs/formats/camera.md)");
  app.add_option("--out", a.run.out_dir, "Folder for frame_0000.png ... and frames.jsonl (docs/formats/headless.md)");
  app.add_option("--settle", a.run.settle_seconds, "Wait for each view to be complete, at most this many seconds")
      ->check(CLI::Range(0.0, 3600.0));
  app.add_option("--realtime", a.run.realtime_fps,
                 "Frames at this rate, not waiting for anything (0: wait as --settle says)")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_flag("--json", a.json, "Print each frame's figures, and a summary, as a line of JSON");
  app.option_defaults()->group("Window");
  app.add_flag("--figures", a.window.show_figures, "Start with the statistics that I shows (default: off)");
  app.add_option("--view", a.window.view,
                 "Link to begin with, as V copies it, also without a window (default: the scene's own first view)");
  app.add_option("--pictures", a.window.picture_directory, "Folder for the pictures that P saves")
      ->check(CLI::ExistingDirectory);
  app.add_option(
      "--record", a.window.record_file,
      "File for the way of the camera, written when the window closes: a path for --path and lumigrid-compare");
  app.add_flag("--settings,!--no-settings", a.use_settings,
               "Keep settings and bookmarks in the user's configuration (docs/formats/settings.md; on unless "
               "--no-settings). Options given here take precedence over settings");
}

/// The calls stand in the order in which --help lists the options.
void describe(CLI::App& app, Arguments& a) {
  app.description(
      "Looks at a scene that a lumigrid server shows: in a window, or with --headless at its first view, or along a "
      "camera path.\n"
      "Only the images and coarse patches near the view travel; a small cache keeps them.");
  app.add_option("URL", a.run.url,
                 "The server, as `lumigrid serve` prints it: ws://host:port/ (http:// and host:port mean the same), or "
                 "encrypted wss://host/; or a "
                 "published scene: https://host/folder/, http://host/folder/ or .../scene.json (no server of ours "
                 "need run there); or a scene's folder on this machine, whose splats, umbrellas, triangles and points, "
                 "and patches where it is published, are read from the disk")
      ->required();
  app.option_defaults()->always_capture_default();

  addContentOptions(app, a);
  addStreamedOptions(app, a);
  addPictureOptions(app, a);
  addLimitOptions(app, a);
  addAccessOptions(app, a);
  addRunOptions(app, a);
}

/// Adds the option's name to an error of its value.
template <class T>
base::Result<T> forOption(const char* option, base::Result<T> value) {
  if (!value) return base::within(option, value.error());
  return value;
}

/// The light of the shadows, and what is contradictory in it.
base::Result<void> parseShadows(Arguments& a) {
  const auto problem = [](std::string text) { return base::Error{base::ErrorCode::kInvalidInput, std::move(text)}; };
  if (std::string text = lod::hlod::shadowProblem(a.shadows, a.method == "hlod"); !text.empty())
    return problem(std::move(text));
  if (!a.light.empty() && !(a.shadows.direction.empty() && a.shadows.position.empty()))
    return problem("--light is a light, too; leave out --light-direction and --light-position");
  a.run.streamed.shadows = *lod::hlod::shadowsFromName(a.shadows.shadows);
  a.window.app.shadows = a.run.streamed.shadows;
  a.run.streamed.light_size = lod::hlod::lightOf(a.shadows, glm::vec3(0.0F, 0.0F, 1.0F), glm::dvec3(0.0)).size;
  const std::vector<double>& position = a.shadows.position;
  if (!position.empty()) a.run.streamed.light_position = glm::dvec3(position[0], position[1], position[2]);
  return {};
}

/// The viewer's own light.
base::Result<void> parseLight(Arguments& a) {
  const std::vector<double>& towards = a.shadows.direction;
  client::OwnLight light;
  if (!a.light.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(light, forOption("--light", client::parseLight(a.light)));
  } else if (!towards.empty()) {
    light = client::OwnLight::towards({towards[0], towards[1], towards[2]});
  }
  if (light.on) a.run.viewer.lumigraph.modes.light = glm::vec3(light.direction());
  a.window.app.light = light;
  return {};
}

/// Puts the values with units and the choices into the options.
base::Result<void> parseArguments(Arguments& a) {
  client::HeadlessOptions& run = a.run;
  LUMIGRID_ASSIGN_OR_RETURN(const auto cache, forOption("--cache", client::parseByteCount(a.cache)));
  LUMIGRID_ASSIGN_OR_RETURN(const auto gpu_memory, forOption("--gpu-memory", client::parseByteCount(a.gpu_memory)));
  LUMIGRID_ASSIGN_OR_RETURN(const auto memory, forOption("--memory", client::parseByteCount(a.memory)));
  const bool of_scene = a.background == "scene";
  LUMIGRID_ASSIGN_OR_RETURN(const auto background,
                            forOption("--background", client::parseColor(of_scene ? "transparent" : a.background)));
  run.scene_background = of_scene;
  if (!a.size.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto size, forOption("--size", client::parseViewSize(a.size)));
    std::tie(a.window.width, a.window.height) = size;
  }
  if (!a.bandwidth.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(run.link.bytes_per_second, forOption("--bandwidth", client::parseBitRate(a.bandwidth)));
  }
  if (!a.latency.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(run.link.latency_seconds, forOption("--latency", client::parseDuration(a.latency)));
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto idle, forOption("--idle", client::parseByteCount(a.idle)));

  run.streamed.kernel = *lod::draw::splatKernelFromName(a.splat);
  run.streamed.frame_seconds = client::secondsPerFrame(a.frame_rate);
  run.streamed.order = *lod::qsplat::streamOrderFromName(a.order);
  run.streamed.idle_bytes = idle;
  run.streamed.memory_bytes = memory;

  client::ViewerOptions& viewer = run.viewer;
  viewer.method = *client::methodFromName(a.method);
  viewer.gpu_budget_bytes = gpu_memory;
  viewer.memory_budget_bytes = memory;
  if (!a.antialias) viewer.samples = 1;
  viewer.lumigraph.modes.resolution_colors = a.colors == "resolution";
  viewer.lumigraph.show_disagreement = a.colors == "disagreement";
  LUMIGRID_TRY(parseShadows(a));
  LUMIGRID_TRY(parseLight(a));
  viewer.session.cache_bytes = cache;
  viewer.lumigraph.use_images = viewer.session.images || viewer.session.frames;
  std::copy(background.begin(), background.end(), viewer.lumigraph.background);
  return {};
}

/// Puts together what opens a private scene: the options count before a link's credential, and that before the
/// environment.
base::Result<void> readAccess(Arguments& a) {
  std::string& token = a.run.access.token;
  const std::string of_link = client::localSceneDirectory(a.run.url) ? "" : client::takeCredential(a.run.url);
  const char* of_environment = std::getenv("LUMIGRID_TOKEN");
  if (!a.token_file.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(token, forOption("--token-file", client::readTokenFile(a.token_file)));
  } else {
    token = !a.token.empty() ? a.token : !of_link.empty() ? of_link : of_environment != nullptr ? of_environment : "";
  }
  if (token.find_first_of("\r\n") != std::string::npos)
    return base::Error{base::ErrorCode::kInvalidInput, "the token has a line end, which no token has"};
  if (!token.empty() && client::wouldExposeToken(a.run.url))
    printError("the token travels unencrypted, and others on the way can read it; use wss:// or https://", 0);
  return {};
}

int runHeadlessMode(const Arguments& a) {
  if (!a.window.record_file.empty())
    return printError("--record is for a window, in which somebody moves; leave out --headless", kWrongUsage);
  if (!a.path_file.empty() && !a.window.view.empty())
    return printError("--view is a picture's view, --path those of many; leave one out", kWrongUsage);

  client::HeadlessOptions options = a.run;
  options.view = a.window.view;
  options.width = a.window.width;
  options.height = a.window.height;
  if (!a.path_file.empty()) {
    auto path = base::readCameraPath(a.path_file);
    if (!path) return printError(path.error().message, kFailed);
    options.path = std::move(path->frames);
  }
  if (!a.size.empty())
    for (base::ViewCamera& camera : options.path) {
      camera.width = a.window.width;
      camera.height = a.window.height;
    }
  options.cancelled = [] { return interrupted.load(); };
  const std::size_t count = std::max<std::size_t>(1, options.path.size());
  options.on_frame = [&](const client::HeadlessFrame& frame) {
    const bool streamed = frame.stats.streamed.drawn > 0;
    const char* const things = frame.stats.streamed.splats.stream.blocks > 0 ? "splats"
                               : streamed                                    ? "points and triangles"
                                                                             : "triangles";
    if (a.json)
      std::printf("%s\n", client::formatHeadlessFrame(frame).c_str());
    else
      std::printf(
          "frame %zu of %zu: %.2f s, %.1f ms to draw, %llu %s, %u images, %.2f MB received%s\n", frame.index + 1, count,
          frame.seconds, frame.draw_ms,
          static_cast<unsigned long long>(streamed ? frame.stats.streamed.drawn : frame.stats.lumigraph.triangles),
          things, frame.stats.lumigraph.samples_used, 1e-6 * static_cast<double>(frame.stats.session.bytes_received),
          frame.stats.complete ? "" : " (not complete)");
    std::fflush(stdout);
  };

  endOnSignals();
  auto done = client::runHeadless(options);
  if (!done) return printError(done.error().message, kFailed);
  if (a.json) {
    const nlohmann::ordered_json summary{
        {"frames", done->frames},     {"incomplete", done->incomplete},        {"seconds", done->seconds},
        {"renderer", done->renderer}, {"bytes", done->session.bytes_received}, {"broken", done->broken}};
    std::printf("%s\n", summary.dump().c_str());
  }
  if (done->broken > 0)
    return printError(std::to_string(done->broken) + " pieces from the server were broken, the last: " +
                          done->last_fault + "; run lumigrid verify on the scene",
                      kFailed);
  return 0;
}

/// Applies the user's settings where the command line has no option.
void applyUserSettings(const CLI::App& app, const client::Settings& kept, client::WindowOptions& options) {
  const auto said = [&app](const char* option) { return app.count(option) > 0; };
  client::ViewerOptions& viewer = options.app.viewer;
  client::StreamedOptions& streamed = options.streamed;
  if (options.method_is_default) viewer.method = client::methodOf(kept);
  if (!said("--splat")) streamed.kernel = static_cast<lod::draw::SplatKernel>(static_cast<int>(kept.splat));
  if (!said("--cutoff")) streamed.cutoff_px = static_cast<float>(kept.cutoff);
  if (!said("--tolerance")) streamed.tolerance = static_cast<float>(kept.tolerance);
  if (!said("--error-px")) streamed.error_px = static_cast<float>(kept.error_px);
  if (!said("--shadows")) options.app.shadows = client::shadowsOf(kept);
  if (!said("--frame-rate")) streamed.frame_seconds = client::secondsPerFrame(kept.frame_rate);
  if (!said("--cache")) viewer.session.cache_bytes = static_cast<std::uint64_t>(kept.cache_megabytes * 1e6);
  if (!said("--gpu-memory")) viewer.gpu_budget_bytes = static_cast<std::uint64_t>(kept.gpu_megabytes * 1e6);
  if (!said("--memory")) viewer.memory_budget_bytes = static_cast<std::uint64_t>(kept.memory_megabytes * 1e6);
  if (!said("--patch-tolerance")) {
    viewer.session.patch_tolerance_px = static_cast<float>(kept.patch_tolerance);
    viewer.session.alone_tolerance_px = static_cast<float>(kept.alone_tolerance);
  }
  if (!said("--guarantee")) viewer.session.guarantee = kept.guarantee != 0.0;
  if (!said("--max-triangles")) viewer.session.max_triangles = static_cast<std::uint32_t>(kept.max_triangles);
  if (!said("--points")) viewer.session.max_points = static_cast<std::uint16_t>(kept.points);
  if (!said("--samples")) viewer.lumigraph.max_samples = static_cast<int>(kept.samples);
  if (!said("--images")) viewer.session.images = kept.images != 0.0;
  if (!said("--frames")) viewer.session.frames = kept.frames != 0.0;
  if (!said("--refine")) viewer.session.refine = kept.refine != 0.0;
  if (!said("--fps")) viewer.fps = kept.fps;
  if (!said("--antialias") && kept.antialias == 0.0) viewer.samples = 1;
  viewer.lumigraph.use_images = viewer.session.images || viewer.session.frames;
}

int runWindowMode(const CLI::App& app, const Arguments& a) {
  if (!a.path_file.empty() || !a.run.out_dir.empty())
    return printError("--path and --out belong to --headless; add it", kWrongUsage);
  if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr)
    return printError("there is no display here (neither DISPLAY nor WAYLAND_DISPLAY is set); use --headless --out DIR",
                      kFailed);
  client::WindowOptions options = a.window;
  options.url = a.run.url;
  if (a.use_settings) {
    options.config_directory = client::userConfigDirectory();
    const client::ReadSettings kept = client::readSettings(options.config_directory);
    for (const std::string& complaint : kept.complaints) printError(complaint, 0);
    options.app.settings = kept.settings;
  }
  options.app.viewer = a.run.viewer;
  options.app.apply_settings = false;
  options.method_is_default = a.run.method_is_default;
  options.streamed = a.run.streamed;
  applyUserSettings(app, options.app.settings, options);
  options.streamed.memory_bytes = options.app.viewer.memory_budget_bytes;
  options.link = a.run.link;
  options.access = a.run.access;
  options.decoder_threads = a.run.decoder_threads;
  options.cancelled = [] { return interrupted.load(); };
  endOnSignals();
  auto done = client::runWindow(options);
  return done ? 0 : printError(done.error().message, kFailed);
}

/// Exit status 1 when something keeps the scene from being shown.
int runHostCheck(const Arguments& a) {
  if (!client::isPublishedScene(a.run.url))
    return printError("--check-host needs the address of a published scene, such as https://example.org/scenes/tower/",
                      kWrongUsage);
  const auto answers = client::askHost(a.run.url, a.run.access);
  if (!answers) return printError(answers.error().message, kFailed);
  bool fails = false;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const client::HostFinding& finding : client::judgeHost(*answers)) {
    const char* grade = client::nameOf(finding.grade);
    fails = fails || finding.grade == client::HostFinding::Grade::kFails;
    if (a.json) {
      list.push_back({{"grade", grade},
                      {"header", finding.header},
                      {"what", finding.message},
                      {"todo", finding.todo},
                      {"nginx", finding.nginx}});
      continue;
    }
    std::printf("%s: %s: %s%s%s\n", grade, finding.header.c_str(), finding.message.c_str(),
                finding.todo.empty() ? "" : " ", finding.todo.c_str());
    if (!finding.nginx.empty()) std::printf("    nginx: %s\n", finding.nginx.c_str());
  }
  if (a.json) std::printf("%s\n", list.dump().c_str());
  return fails ? kFailed : 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app;
  describe(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongUsage;
  }
  const std::string& link = arguments.window.view;
  arguments.run.method_is_default = app.count("--method") == 0 && link.empty();
  if (auto access = readAccess(arguments); !access) return printError(access.error().message, kWrongUsage);
  if (auto url = client::checkUrl(arguments.run.url); !url) return printError(url.error().message, kWrongUsage);
  if (client::localSceneDirectory(arguments.run.url) && (app.count("--bandwidth") + app.count("--latency")) > 0)
    return printError("--bandwidth and --latency are for a link; this scene is on this machine", kWrongUsage);
  if (!link.empty()) {
    const auto view = client::parsePermalink(link);
    if (!view) return printError("--view: " + view.error().message, kWrongUsage);
    // A link names its method.
    if (app.count("--method") == 0) arguments.method = client::nameOf(view->method);
  }
  if (auto parsed = parseArguments(arguments); !parsed) return printError(parsed.error().message, kWrongUsage);
  if (arguments.check_host) return runHostCheck(arguments);
  return arguments.headless ? runHeadlessMode(arguments) : runWindowMode(app, arguments);
}
