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
#include "client/source/streamed_hlod.h"
#include "client/source/streamed_splats.h"
#include "client/source/streamed_umbrellas.h"
#include "lod/disk_bytes.h"
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

/// The file of a streamed method in a folder. It stays open as long as anybody shows it.
class LocalFileLink final : public Link {
 public:
  explicit LocalFileLink(std::shared_ptr<StreamedView> view) : view_(std::move(view)) {}
  bool pump(Session& session) override { return view_->pump(session, secondsNow()); }
  void waitForArrival(double seconds) override { rest(seconds); }
  std::shared_ptr<StreamedView> streamed() const override { return view_; }

 private:
  const std::shared_ptr<StreamedView> view_;
};

base::Result<std::shared_ptr<StreamedView>> openFile(const FilePlace& file, Method method,
                                                     const protocol::Welcome& welcome, const StreamedOptions& options) {
  const std::string path = file.place + "/" + file.name;
  if (method == Method::kQsplat) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto tree, lod::qsplat::SplatFile::open(path));
    LUMIGRID_ASSIGN_OR_RETURN(std::shared_ptr<lod::qsplat::FileBlocks> blocks,
                              lod::qsplat::openBlocks(tree.bytes(), tree.header()));
    return std::shared_ptr<StreamedView>(std::make_shared<StreamedSplats>(file, welcome, std::move(blocks), options));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto opened, base::PositionedFile::open(path));
  auto bytes = std::make_shared<lod::DiskBytes>(std::move(opened));
  if (method == Method::kHlod)
    return std::shared_ptr<StreamedView>(std::make_shared<StreamedHlod>(file, welcome, std::move(bytes), options));
  return std::shared_ptr<StreamedView>(std::make_shared<StreamedUmbrellas>(file, welcome, std::move(bytes), options));
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
  if (!patches || !base::isPublishedName(patches->name)) {
    const std::optional<Method> method = streamedMethodOf(scene);
    std::string reason = directory +
                         ": without a server patches are shown of what `lumigrid publish` wrote; serve or "
                         "publish it";
    const std::string content(method ? contentOf(*method) : "");
    if (!patches && method) reason = directory + ": holds " + content + " only";
    if (method) reason += "; --method " + std::string(nameOf(*method)) + " shows its " + content;
    return std::unique_ptr<Link>(std::make_unique<RefusedLink>(reason, method));
  }
  StaticScene files;
  files.place = directory;
  files.patches = *patches;
  files.records = objectOfPart(scene, "records", ".lgr").value_or(StaticObject{});
  files.index = objectOfPart(scene, "images/index", ".lgi");
  files.welcome = protocol::welcomeOf(scene, nameOf(directory));
  return std::unique_ptr<Link>(std::make_unique<LocalSceneLink>(std::move(files), directory));
}

base::Result<std::unique_ptr<Link>> openLocalFile(const std::string& directory, Method method,
                                                  const StreamedOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(directory));
  const auto part = objectOfMethod(scene, method);
  if (!part) {
    const bool published = base::isPublishedName(base::patchPath(directory, scene));
    return std::unique_ptr<Link>(
        std::make_unique<RefusedLink>(directory + lackOf(method), insteadOf(method, scene, published)));
  }
  protocol::Welcome welcome = protocol::welcomeOf(scene, nameOf(directory));
  welcome.has_colors = scene.has_colors;
  StreamedOptions local = options;
  if (!local.clock) local.clock = secondsNow;
  local.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
    base::parallelFor(count, 0, body);
  };
  LUMIGRID_ASSIGN_OR_RETURN(auto view, openFile({directory, part->name, part->bytes}, method, welcome, local));
  return std::unique_ptr<Link>(std::make_unique<LocalFileLink>(std::move(view)));
}

}  // namespace client
