#pragma once
// A published scene in a browser. The page's JavaScript reads scene.json and the index's parameters
// (client/web/site/static_scene.js), and passes them as plain values.
#include <memory>
#include <string>

#include "client/source/session.h"
#include "client/source/static_source.h"
#include "client/web/web_fetcher.h"
#include "client/web/web_welcome.h"

namespace client {

class WebScene {
 public:
  /// `numbers`: kWelcomeNumbers, then the length of the patches and of the index (0: none).
  WebScene(const std::string& place, const std::string& name, const std::string& units, const std::string& patches,
           const std::string& index, const double* numbers);
  StaticSource& source() { return source_; }

 private:
  WebFetcher fetcher_;
  StaticSource source_;
};

}  // namespace client
