#pragma once
// The camera paths of camera_paths.h in an interior, in whose rooms one stands and walks.
#include <glm/glm.hpp>
#include <vector>

#include "server/views/indoors.h"

namespace server {

/// An eye of a path, scene-local; the direction is unit.
struct IndoorEye {
  glm::vec3 position{0.0F};
  glm::vec3 direction{0.0F};
};

/// Each of these is the eye's way in `frames` steps of `seconds` each; the path of docs/formats/comparison.md of that
/// name, at the same speed.
using IndoorPath = std::vector<IndoorEye> (*)(const Indoors& indoors, double seconds, int frames);

/// Stands where the view is widest and turns, ten degrees a second.
std::vector<IndoorEye> indoorOrbit(const Indoors& indoors, double seconds, int frames);
/// Along the longest clear line towards the wall at its end; the distance halves every four seconds.
std::vector<IndoorEye> indoorApproach(const Indoors& indoors, double seconds, int frames);
/// Through the rooms at eye level, a diagonal of the box in about twelve seconds, looking ahead.
std::vector<IndoorEye> indoorWalk(const Indoors& indoors, double seconds, int frames);
/// Three seconds at one place, a second on the way to the next.
std::vector<IndoorEye> indoorInspection(const Indoors& indoors, double seconds, int frames);
/// Stands and turns by two degrees a second in a hand that trembles by half a degree.
std::vector<IndoorEye> indoorJitter(const Indoors& indoors, double seconds, int frames);

/// So many eyes evenly along that walk once, each as one who walks there slowly.
std::vector<IndoorEye> indoorTour(const Indoors& indoors, int frames);

}  // namespace server
