#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "server/cli/commands.h"
#include "server/cli/config_file.h"
#include "server/cli/console.h"
#include "server/cli/supervisor.h"
#include "server/log/server_log.h"
#include "server/net/page_files.h"
#include "server/net/scene_names.h"
#include "server/net/server.h"
#include "spdlog/spdlog.h"

namespace server::cli {
namespace {

struct ServeArguments {
  std::vector<std::string> scenes;
  ServerOptions options;
  std::string config;
  LogOptions log;
  std::string web;
  double max_picture_megapixels = 64.0;
  unsigned workers = 1;
  bool scenes_are_configured = false;  // and not named on the command line
  bool no_frames = false;
  bool no_access = false;
  bool json = false;
};

bool usesTls(const ServeArguments& a) {
  return !a.options.certificate_file.empty();
}

std::string socketScheme(const ServeArguments& a) {
  return usesTls(a) ? "wss://" : "ws://";
}

/// `names`: of the scenes, in their order; an only scene's is empty.
void printAddressesJson(const ServeArguments& a, std::uint16_t port, const std::vector<std::string>& names) {
  const std::string url = socketScheme(a) + placeText(a.options.address, port) + "/";
  nlohmann::ordered_json j{{"port", port}, {"url", url}};
  for (const std::string& name : names)
    if (!name.empty()) j["scenes"].push_back({{"name", name}, {"url", url + name + "/"}});
  std::printf("%s\n", j.dump().c_str());
}

void printAddressesText(const ServeArguments& a, std::uint16_t port, const std::vector<std::string>& names) {
  const char* page = a.options.page_directory.empty() ? "" : " (open it in a browser)";
  const std::string url = (usesTls(a) ? "https://" : "http://") + placeText(a.options.address, port);
  const std::string socket = socketScheme(a) + placeText(a.options.address, port);
  if (a.scenes.size() == 1) {
    std::printf("serving %s at %s/%s\nlook at it with: lumigrid-view %s/\n", a.scenes.front().c_str(), url.c_str(),
                page, socket.c_str());
    return;
  }
  std::printf("serving %zu scenes at %s/%s\n", a.scenes.size(), url.c_str(), page);
  for (std::size_t i = 0; i < names.size(); ++i)
    std::printf("%s: lumigrid-view %s/%s/\n", a.scenes[i].c_str(), socket.c_str(), names[i].c_str());
}

void printAddresses(const ServeArguments& a, std::uint16_t port, const std::vector<std::string>& names) {
  if (a.json)
    printAddressesJson(a, port, names);
  else
    printAddressesText(a, port, names);
  std::fflush(stdout);
}

/// Takes what the command line leaves out from the file of --config.
base::Result<void> completeArguments(CLI::App& command, ServeArguments& a) {
  if (!a.config.empty()) LUMIGRID_TRY(applyConfigFile(command, a.config, "config", "scenes", "SCENE"));
  if (!a.scenes.empty()) return {};
  return base::Error{base::ErrorCode::kInvalidInput,
                     "SCENE is required: name a scene's directory, or a file with \"scenes\" by --config"};
}

/// `log` outlives the metrics.
void countLines(ServerMetrics& metrics, const ServerLog& log) {
  const auto count = [&](const char* outcome, std::uint64_t LogCounts::*lines) {
    metrics.all.read(Metrics::Kind::kCounter, "lumigrid_log_lines_total", "Lines of the log, by what became of them.",
                     {{"outcome", outcome}}, [&log, lines] { return static_cast<double>(log.counts().*lines); });
  };
  count("written", &LogCounts::written);
  count("dropped", &LogCounts::dropped);
  count("left_out", &LogCounts::left_out);
  count("failed", &LogCounts::failed);
}

/// The scenes that the file of --config names by now, where they came from it.
std::optional<std::vector<std::string>> scenesOfConfig(const ServeArguments& a) {
  if (!a.scenes_are_configured) return std::nullopt;
  auto scenes = textsInConfigFile(a.config, "scenes");
  if (scenes) return std::move(*scenes);
  spdlog::warn("the scenes stay as they were: {}", scenes.error().message);
  return std::nullopt;
}

volatile std::sig_atomic_t hangup_came = 0;

/// Serves in this process. `ready` is called once connections are accepted, `worker` is its number among several.
int serveHere(const ServeArguments& a, const std::function<void(const Server&)>& ready,
              std::optional<unsigned> worker = std::nullopt) {
  auto log = ServerLog::open(a.log);
  if (!log) return fail(log.error());
  (*log)->install();
  // A worker that is started again serves what the others do by now.
  const std::vector<std::string> scenes = scenesOfConfig(a).value_or(a.scenes);
  // Until the server listens for it; a terminal that closes, or an operator, may send it while scenes are opened.
  std::signal(SIGHUP, [](int) { hangup_came = 1; });
  auto server = Server::open(scenes, a.options);
  if (!server) return fail(server.error());
  ready(**server);
  countLines((*server)->metrics(), **log);
  if (worker) (*server)->metrics().all.labelAll({{"worker", std::to_string(*worker)}});
  (*server)->onReload({.at_once =
                           [&log] {
                             spdlog::info("reload: the log is opened anew");
                             (*log)->reopen();
                           },
                       .read_places = [&a] { return scenesOfConfig(a); }});
  if (hangup_came != 0) (*server)->reload();
  const int status = exitStatus((*server)->run(true));
  if (!(*server)->hangs()) return status;
  log->reset();  // writes the lines that wait
  std::_Exit(status);
}

/// Serves in several processes that share the port. Each takes its part of the limits.
int serveByWorkers(ServeArguments& a) {
  auto kept = keepPort(a.options.address, a.options.port);
  if (!kept) return fail(kept.error());
  a.options.port = kept->port;
  a.options.shares_port = true;
  a.options.max_connections = (a.options.max_connections + a.workers - 1) / a.workers;
  a.options.connections_per_address = (a.options.connections_per_address + a.workers - 1) / a.workers;
  a.options.message_cache_bytes /= a.workers;
  a.options.held_bytes /= a.workers;
  std::vector<std::string> names{""};
  if (a.scenes.size() > 1) {
    auto several = sceneNames(a.scenes);
    if (!several) return fail(several.error());
    names = std::move(*several);
  }
  // A reader of the log that stops reading must not keep the supervisor from its signals.
  auto log = ServerLog::open(a.log);
  if (!log) return fail(log.error());
  const auto before_log = spdlog::default_logger();
  (*log)->install();
  const auto worker = [&](unsigned number, const std::function<void()>& ready) {
    spdlog::set_default_logger(before_log);  // the log's thread is not in this process
    return serveHere(
        a, [&ready](const Server&) { ready(); }, number);
  };
  return supervise(
      a.workers, worker, [&] { printAddresses(a, kept->port, names); }, [&log] { (*log)->reopen(); });
}

int run(CLI::App& command, ServeArguments& a) {
  a.scenes_are_configured = a.scenes.empty();
  if (auto complete = completeArguments(command, a); !complete) {
    fail(complete.error());
    return kWrongUsage;
  }
  ignoreBrokenPipes();
  a.options.render_frames = !a.no_frames;
  a.options.count_access = !a.no_access;
  a.options.max_picture_pixels = static_cast<std::uint64_t>(a.max_picture_megapixels * 1e6);
  if (a.web != "off") a.options.page_directory = a.web.empty() ? installedPageFiles() : a.web;
  if (a.workers > 1) return serveByWorkers(a);
  return serveHere(a, [&a](const Server& server) { printAddresses(a, server.port(), server.names()); });
}

/// Who may see the scenes, and how they are kept from others (docs/private-scenes.md).
void addAccessOptions(CLI::App& command, ServerOptions& options) {
  AccessOptions& access = options.access;
  command.add_flag("--public", access.is_public,
                   "other machines may reach this server; needed where --address is none of this machine's own. "
                   "Besides it one of --open, --tokens, --signing-key");
  command.add_flag("--open", access.is_open, "anybody may see the scenes, and pages of any host may read them");
  command.add_option("--tokens", access.token_file,
                     "JSON file of tokens that open private scenes (docs/private-scenes.md); read again on SIGHUP");
  command.add_option("--signing-key", access.signing_keys,
                     "file of keys whose signed links open private scenes (`lumigrid sign`); read again on SIGHUP");
  command.add_option(
      "--allow-origin", access.origins,
      "origin whose pages may read the scenes besides the server's own: https://example.org. Repeatable");
  command.add_option("--host", access.hosts,
                     "name by which the server may be asked, as a proxy's; by others it answers 421. Repeatable");
  command.add_option("--trusted-proxy", access.trusted_proxies,
                     "address of a proxy whose X-Forwarded-For and X-Forwarded-Proto count: 10.0.0.1, 10.0.0.0/8. "
                     "Repeatable");
  command.add_option("--certificate", options.certificate_file,
                     "the server's certificate (PEM), and those between it and its authority: speaks TLS. Read again "
                     "on SIGHUP");
  command.add_option("--key", options.key_file, "the certificate's key (PEM)");
}

/// How much of the server one visitor may have (docs/hosting-server.md).
void addLimitOptions(CLI::App& command, ServerOptions& options) {
  command.add_option("--max-connections", options.max_connections, "connections at a time; more are answered 503");
  command.add_option("--connections-per-address", options.connections_per_address,
                     "connections of one address at a time; more are answered 429");
  command
      .add_option("--pictures-per-address", options.picture_limits.of_one_address,
                  "pictures of one address that wait, are drawn or are not yet fetched; more are answered 503")
      ->check(CLI::Range(1, 1000));
  command
      .add_option("--idle", options.idle_seconds,
                  "seconds after which a viewer that sent nothing is let go; it may connect again")
      ->check(CLI::Range(1.0, 1e6));
  command
      .add_option("--hello", options.hello_seconds,
                  "seconds that a viewer has for its first message before it is let go")
      ->check(CLI::Range(0.1, 1e6));
  command
      .add_option("--stall", options.stall_seconds,
                  "seconds after which a viewer that takes nothing of what waits for it is dropped")
      ->check(CLI::Range(0.1, 1e6));
  command
      .add_option("--messages-per-second", options.messages_per_second,
                  "messages of one viewer that are read each second in the long run; others wait on its side. Viewers "
                  "that move send 60 and more")
      ->check(CLI::Range(1.0, 1e6));
  command
      .add_option("--views-per-second", options.views_per_second,
                  "views of one viewer that moves for which is planned each second while others wait; it is sent what "
                  "was planned meanwhile")
      ->check(CLI::Range(0.1, 1e6));
  command
      .add_option("--held-memory", options.held_bytes,
                  "memory for which images all viewers hold, e.g. 512M; where it is full, some are sent again to who "
                  "has them. 1024 images of each viewer are remembered all the same")
      ->transform(CLI::AsSizeValue(true));
}

}  // namespace

RunCommand addServe(CLI::App& command) {
  auto a = std::make_shared<ServeArguments>();
  command
      .add_option(
          "SCENE", a->scenes,
          "scene directory made by `lumigrid build` or `publish`, or where a published scene lies: https://host/scene, "
          "s3://bucket/scene (docs/places.md). Several: each is served below its directory's name, and / lists them")
      ->default_str("");
  command.add_option("--config", a->config,
                     "JSON file with the options that the command line leaves out: {\"scenes\": [\"tower\"], \"port\": "
                     "8080} (docs/formats/config.md)");
  command
      .add_option("--workers", a->workers,
                  "processes that share the port and the limits; one that ends is started again. Several draw frames "
                  "side by side (docs/hosting-server.md)")
      ->check(CLI::Range(1, 256));
  command.add_option("--address", a->options.address,
                     "address to listen at; 0.0.0.0 for every network of this machine, with --public");
  addAccessOptions(command, a->options);
  command.add_option("--port", a->options.port, "port; 0 picks a free one and prints it");
  addLimitOptions(command, a->options);
  command.add_option("--web", a->web,
                     "folder with the browser client's files, served at /; off: none. Default: ../share/lumigrid/web "
                     "beside the folder of this program, where installing puts them");
  command
      .add_option("--max-picture", a->max_picture_megapixels,
                  "most megapixels of a picture asked for at /render; 0: render none")
      ->check(CLI::Range(0.0, 1000.0));
  command
      .add_option("--max-waiting-pictures", a->options.picture_limits.waiting,
                  "pictures that may wait while one is rendered; further ones are answered 503")
      ->check(CLI::Range(0, 1000));
  command.add_flag("--no-frames", a->no_frames,
                   "never render exact frames for viewers at rest, nor pictures (saves CPU or GPU)");
  command
      .add_option("--prefetch", a->options.ahead_bytes,
                  "bytes that a viewer at rest is sent beyond what its view needs, e.g. 4M; 0: none, which makes "
                  "pictures repeatable")
      ->transform(CLI::AsSizeValue(true));
  command
      .add_option("--message-cache", a->options.message_cache_bytes,
                  "memory for what several viewers are sent, e.g. 256M; 0: none")
      ->transform(CLI::AsSizeValue(true));
  command.add_option("--access-file", a->options.access_file,
                     "file that keeps how often each image and patch group was sent to viewers; default: access.lga in "
                     "the scene; servers may share it, and keep the counts of a scene that was replaced beside it");
  command
      .add_option("--access-interval", a->options.access_interval_seconds,
                  "seconds between writes of that file: the most that a killed server forgets")
      ->check(CLI::Range(0.01, 86400.0));
  command.add_flag("--no-access", a->no_access, "count nothing and write nothing");
  command.add_option(
      "--cache", a->options.remote.cache_directory,
      "directory that keeps what was read of a scene behind a network; default: $XDG_CACHE_HOME/lumigrid "
      "or ~/.cache/lumigrid; servers may share it");
  command.add_option("--cache-size", a->options.remote.cache_bytes, "most bytes of images to keep there, e.g. 4G")
      ->transform(CLI::AsSizeValue(false));
  command
      .add_option(
          "--drain", a->options.drain_seconds,
          "seconds after SIGTERM within which downloads under way are finished, e.g. 30s; viewers are sent elsewhere "
          "at once, and new requests are answered 503")
      ->transform(CLI::AsNumberWithUnit(std::map<std::string, double>{{"s", 1.0}, {"min", 60.0}}))
      ->check(CLI::Range(0.0, 86400.0));
  command.add_option("--log", a->log.file,
                     "file that the log is appended to, opened anew on SIGHUP; default: standard error");
  command.add_flag("--log-json", a->log.json, "log one JSON object a line (docs/formats/log.md)");
  command.add_flag("--json", a->json, "print port and URL as JSON");
  return [a, &command] { return run(command, *a); };
}

}  // namespace server::cli
