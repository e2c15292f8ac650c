#include "client/native/local_scene.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <thread>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "base/parallel.h"
#include "client/native/published_scene.h"
#include "client/source/streamed_splats.h"
#include "lod/qsplat/splat_file.h"
#include "protocol/welcome.h"
#include "repository/sampling/parameters.h"

namespace client {
namespace {

namespace fs = std::filesystem;

double secondsNow() {
  return std::chrono::duration<double>(LinkClock::Clock::now().time_since_epoch()).count();
}

/// Waits for what does not come over the link, such as decoded images.
void rest(double seconds) {
  std::this_thread::sleep_for(LinkClock::toDuration(seconds));
}

/// Names a scene by its folder.
std::string nameOf(const std::string& directory) {
  std::error_code error;
  const fs::path whole = fs::canonical(directory, error);
  return error ? directory : whole.filename().string();
}

/// Answers ranges of a folder's files at once.
class FileFetcher final : public RangeFetcher {
 public:
  explicit FileFetcher(std::string directory) : directory_(std::move(directory)) {}
  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override {
    answers_.push_back(read(name, offset, length));
    answers_.back().id = id;
  }
  std::vector<FetchAnswer> takeAnswers() override { return std::exchange(answers_, {}); }
  void cancel(std::uint64_t id) override {
    std::erase_if(answers_, [id](const FetchAnswer& answer) { return answer.id == id; });
  }
  bool empty() const { return answers_.empty(); }

 private:
  FetchAnswer read(const std::string& name, std::uint64_t offset, std::uint64_t length) {
    FetchAnswer answer;
    auto file = files_.find(name);
    if (file == files_.end()) {
      auto opened = base::PositionedFile::open(directory_ + "/" + name);
      if (!opened) {
        answer.outcome = FetchOutcome::kNotFound;
        return answer;
      }
      file = files_.emplace(name, std::move(*opened)).first;
    }
    const std::uint64_t size = file->second.size();
    answer.outcome = FetchOutcome::kTooShort;  // a file that cannot be read any more counts as cut
    if (offset > size || length > size - offset) return answer;
    answer.bytes.resize(static_cast<std::size_t>(length));
    if (file->second.readAt(offset, answer.bytes))
      answer.outcome = FetchOutcome::kBytes;
    else
      answer.bytes.clear();
    return answer;
  }

  const std::string directory_;
  std::map<std::string, base::PositionedFile> files_;
  std::vector<FetchAnswer> answers_;
};

/// A published scene in a folder.
class LocalSceneLink final : public Link {
 public:
  LocalSceneLink(StaticScene scene, const std::string& directory)
      : fetcher_(directory), source_(std::move(scene), fetcher_, [](const std::string& parameters) {
          return repository::sampledPointsFromMeta(parameters, "parameters");
        }) {}
  bool pump(Session& session) override { return source_.pump(session, secondsNow()); }
  void waitForArrival(double seconds) override {
    if (fetcher_.empty()) rest(seconds);
  }
  bool pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) override {
    source_.pick(id, origin, direction);
    return true;
  }
  std::vector<AnsweredPick> takePicks() override { return source_.takePicks(); }

 private:
  FileFetcher fetcher_;
  StaticSource source_;
};

/// A scene that cannot be shown by the method asked for.
class RefusedLink final : public Link {
 public:
  RefusedLink(std::string reason, std::optional<Method> instead) : reason_(std::move(reason)), instead_(instead) {}
  bool pump(Session& session) override {
    if (session.phase() != SessionPhase::kRefused) session.refuse(reason_, instead_);
    return false;
  }
  void waitForArrival(double seconds) override { rest(seconds); }

 private:
  const std::string reason_;
  const std::optional<Method> instead_;
};

/// The splats of a folder. The file stays open as long as anybody shows it.
class LocalSplatLink final : public Link {
 public:
  explicit LocalSplatLink(std::shared_ptr<StreamedSplats> splats) : splats_(std::move(splats)) {}
  bool pump(Session& session) override { return splats_->pump(session, secondsNow()); }
  void waitForArrival(double seconds) override { rest(seconds); }
  std::shared_ptr<SplatView> splats() const override { return splats_; }

 private:
  const std::shared_ptr<StreamedSplats> splats_;
};

base::Result<std::shared_ptr<lod::qsplat::FileBlocks>> openSplatBlocks(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::qsplat::SplatFile::open(path));
  LUMIGRID_ASSIGN_OR_RETURN(auto blocks, lod::qsplat::openBlocks(file.bytes(), file.header()));
  return std::shared_ptr<lod::qsplat::FileBlocks>(std::move(blocks));
}

}  // namespace

std::optional<std::string> localSceneDirectory(const std::string& text) {
  if (text.find("://") != std::string::npos) return std::nullopt;
  const std::string directory = placeOfScene(text);
  std::error_code error;
  if (directory.empty() || !fs::is_regular_file(directory + "/scene.json", error)) return std::nullopt;
  return directory;
}

base::Result<std::unique_ptr<Link>> openLocalScene(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(directory));
  const auto patches = objectOfPart(scene, "patch", ".lgp");
  const bool splats = objectOfPart(scene, "qsplat", ".lgq").has_value();
  if (!patches || !base::isPublishedName(patches->name)) {
    const std::string reason =
        patches
            ? directory + ": without a server patches are shown of what `lumigrid publish` wrote; serve or publish it"
            : directory + ": holds splats only";
    return std::unique_ptr<Link>(
        std::make_unique<RefusedLink>(splats ? reason + "; --method qsplat shows its splats" : reason,
                                      splats ? std::optional(Method::kQsplat) : std::nullopt));
  }
  StaticScene files;
  files.place = directory;
  files.patches = *patches;
  files.index = objectOfPart(scene, "images/index", ".lgi");
  files.welcome = protocol::welcomeOf(scene, nameOf(directory));
  return std::unique_ptr<Link>(std::make_unique<LocalSceneLink>(std::move(files), directory));
}

base::Result<std::unique_ptr<Link>> openLocalSplats(const std::string& directory, const SplatOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(directory));
  const auto part = objectOfPart(scene, "qsplat", ".lgq");
  if (!part) {
    const bool published = base::isPublishedName(base::patchPath(directory, scene));
    return std::unique_ptr<Link>(std::make_unique<RefusedLink>(
        directory + ": has no splats (qsplat.lgq); build them with `lumigrid build ... --methods qsplat`",
        published ? std::optional(Method::kLumigraph) : std::nullopt));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto blocks, openSplatBlocks(base::splatPath(directory, scene)));
  protocol::Welcome welcome = protocol::welcomeOf(scene, nameOf(directory));
  welcome.has_colors = scene.has_colors;
  SplatOptions local = options;
  if (!local.clock) local.clock = secondsNow;
  local.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
    base::parallelFor(count, 0, body);
  };
  return std::unique_ptr<Link>(std::make_unique<LocalSplatLink>(std::make_shared<StreamedSplats>(
      SplatFilePlace{directory, part->name, part->bytes}, std::move(welcome), std::move(blocks), local)));
}

}  // namespace client
