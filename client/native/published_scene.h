#pragma once
// Opens a published scene at a URL: translates scene.json to the plain values that client::StaticSource takes, and
// provides the link that reads the scene.
#include <optional>
#include <string>

#include "base/json/scene_file.h"
#include "client/native/curl_fetcher.h"
#include "client/native/link.h"
#include "client/source/backoff.h"
#include "client/source/static_source.h"

namespace client {

/// Returns the object of the part that is called stem.extension, or has that stem and extension in its published name.
/// nullopt when the scene lists neither.
std::optional<StaticObject> objectOfPart(const base::Scene& scene, const std::string& stem,
                                         const std::string& extension);
/// Returns the object of a method for which isStreamed(); nullopt when the scene lacks it.
std::optional<StaticObject> objectOfMethod(const base::Scene& scene, Method method);
/// Returns the first of these methods whose file the scene has.
std::optional<Method> streamedMethodOf(const base::Scene& scene);
/// Says behind a scene's place that it lacks the method's file, and what to do.
std::string lackOf(Method method);
/// The method that shows a scene that lacks the file of `method`. `patches`: they can be shown.
std::optional<Method> insteadOf(Method method, const base::Scene& scene, bool patches);
/// `place` is the URL without "scene.json" and without slashes at its end. Errors say what is wrong with the scene.
base::Result<StaticScene> staticSceneFrom(const base::Scene& scene, const std::string& place);
/// Shortens "http://host/folder/scene.json" or "http://host/folder/" to "http://host/folder".
std::string placeOfScene(const std::string& url);

/// Fetches scene.json, again and again while the host does not answer.
class SceneJson {
 public:
  /// `fetcher` outlives it, and has no other requests under way until scene.json is here.
  SceneJson(CurlFetcher& fetcher, std::string place);
  /// Returns the text once, when it has arrived. Reports failures to the session.
  std::optional<std::string> takeText(Session& session, double now);
  std::uint64_t bytes() const { return bytes_; }

 private:
  void requestText();
  CurlFetcher& fetcher_;
  const std::string place_;
  bool asked_ = false;
  Backoff backoff_;
  std::uint64_t bytes_ = 0;
  double retry_at_ = 0.0;
};

/// Fetches scene.json, then what views need. Tries again while the host does not answer, and opens the scene anew after
/// that.
class PublishedSceneLink final : public Link {
 public:
  explicit PublishedSceneLink(const std::string& url, const LinkLimit& limit = {}, const HostAccess& access = {})
      : place_(placeOfScene(url)), fetcher_(place_, limit, access), scene_json_(fetcher_, place_) {}
  bool pump(Session& session) override;
  void waitForArrival(double seconds) override { fetcher_.wait(seconds); }
  /// False until scene.json is here.
  bool pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) override;
  std::vector<AnsweredPick> takePicks() override;
  LinkCounts counts() const override;

 private:
  bool acceptScene(Session& session, double now);

  const std::string place_;
  CurlFetcher fetcher_;
  SceneJson scene_json_;
  bool refused_ = false;
  std::optional<StaticSource> source_;  // once scene.json is here
};

}  // namespace client
