#pragma once
// A published scene at a URL: scene.json as the plain values that client::StaticSource takes, and the link that reads
// it.
#include <optional>
#include <string>

#include "base/json/scene_file.h"
#include "client/native/link.h"
#include "client/source/static_source.h"

namespace client {

/// `place`: the URL without "scene.json" and slashes at its end. Errors say what is wrong with the text; kUnsupported:
/// it has splats alone.
base::Result<StaticScene> staticSceneFrom(const std::string& scene_json, const std::string& place);
/// Grid and tree, by nlohmann-json.
ReadParameters parametersReader();
/// "http://host/folder/scene.json" or "http://host/folder/" as "http://host/folder".
std::string placeOfScene(const std::string& url);

/// What scene.json says to people: name, units, origin, box, up and light.
protocol::Welcome welcomeFrom(const base::Scene& scene, const std::string& place);
/// The part of a scene that is called stem.extension, or has it in its published name.
std::optional<StaticObject> partOf(const base::Scene& scene, const std::string& stem, const std::string& extension);

class CurlFetcher;

/// scene.json on its way; asked for again while the host is away.
class SceneJson {
 public:
  /// `fetcher` outlives it; nobody else has anything under way there until it is here.
  SceneJson(CurlFetcher& fetcher, std::string place);
  /// The text, once. Tells the session what keeps it.
  std::optional<std::string> takeText(Session& session, double now);
  std::uint64_t bytes() const { return bytes_; }

 private:
  void requestText();
  CurlFetcher& fetcher_;
  const std::string place_;
  bool asked_ = false;
  int failures_ = 0;
  std::uint64_t bytes_ = 0;
  double retry_at_ = 0.0;
};

/// Fetches scene.json, then what views need. Tries again when the host is away; opens the scene anew after that.
class PublishedSceneLink final : public Link {
 public:
  explicit PublishedSceneLink(const std::string& url, const LinkLimit& limit = {});
  ~PublishedSceneLink() override;
  bool pump(Session& session) override;
  void waitForArrival(double seconds) override;
  /// False until scene.json is here.
  bool pick(std::uint32_t id, const glm::dvec3& origin, const glm::dvec3& direction) override;
  std::vector<AnsweredPick> takePicks() override;
  LinkCounts counts() const override;
  /// Null until scene.json is here.
  const StaticSource* source() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
