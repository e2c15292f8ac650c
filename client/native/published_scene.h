#pragma once
// A published scene at a URL: scene.json as the plain values that client::StaticSource takes, and the link that reads
// it.
#include <string>

#include "client/native/link.h"
#include "client/static_source.h"

namespace client {

/// `place`: the URL without "scene.json" and slashes at its end. Errors say what is wrong with the text.
base::Result<StaticScene> staticSceneFrom(const std::string& scene_json, const std::string& place);
/// Grid and tree, by nlohmann-json.
ReadParameters parametersReader();
/// "http://host/folder/scene.json" or "http://host/folder/" as "http://host/folder".
std::string placeOfScene(const std::string& url);

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
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace client
