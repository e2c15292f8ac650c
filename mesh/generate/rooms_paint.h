#pragma once
// The layout and the colours of the generated flat. Four rooms lie around a cross of walls with a door in each arm; x
// and y run along the walls and z up. All its surfaces face the rooms, as a scanner in them sees them.
#include <array>
#include <vector>

#include "mesh/generate/lettering.h"

namespace mesh::generate {

inline constexpr glm::dvec3 kRoomSize{4.6, 4.0, 2.6};  // metres
inline constexpr double kRoomWall = 0.16;              // metres: the thickness of the walls between
inline constexpr double kDoorWidth = 0.96, kDoorHeight = 2.04;

enum class RoomFinish { kFloor, kCeiling, kWall, kJamb, kFurniture };

/// A rectangle of even finish. Seen from its room, s runs along `right` and t along `up`, in metres.
struct RoomPanel {
  glm::dvec3 origin;     ///< of s = 0, t = 0
  glm::dvec3 right, up;  ///< unit vectors
  glm::dvec2 low, high;  ///< s and t of its corners
  RoomFinish finish = RoomFinish::kWall;
  std::uint32_t room = 0;
  std::uint32_t number = 0;  ///< of the wall in its room, 0 to 3, or of the piece of furniture
  glm::dvec3 at(const glm::dvec2& st) const { return origin + st.x * right + st.y * up; }
};

class RoomsPaint : public SurfacePaint {
 public:
  explicit RoomsPaint(std::uint64_t seed);
  const std::vector<Sign>& signs() const override { return signs_; }
  glm::dvec3 colorAt(const glm::dvec3& point, double texel) const override;

  const std::vector<RoomPanel>& panels() const { return panels_; }
  glm::dvec3 color(const RoomPanel& panel, const glm::dvec2& st, double texel) const;
  /// How even a panel must be there: 1 beneath signs, 0 farther from them.
  double evenness(const RoomPanel& panel, const glm::dvec2& st) const;

 private:
  struct Picture {
    glm::dvec2 low, high;
    std::uint32_t salt;
  };
  struct Wall {
    Lettering lettering;
    std::vector<Picture> pictures;
    bool has_door = false;
  };
  void build();
  void furnish(std::uint32_t room, const glm::dvec2& corner);
  void hang(Wall& wall, std::uint32_t number);
  std::uint32_t wallNumber(const RoomPanel& panel) const { return 4 * panel.room + panel.number; }
  double noise(const glm::dvec2& p, double wavelength, double texel, std::uint32_t salt) const;
  glm::dvec3 planks(const glm::dvec2& p, double texel, std::uint32_t room) const;
  glm::dvec3 paper(const glm::dvec2& p, double texel, std::uint32_t room) const;
  glm::dvec3 painting(const Picture& picture, const glm::dvec2& p, double texel) const;
  glm::dvec3 cloth(const glm::dvec2& p, double texel, std::uint32_t number) const;

  std::uint32_t seed_;
  std::vector<RoomPanel> panels_;
  std::array<Wall, 16> walls_;
  std::vector<Sign> signs_;
};

}  // namespace mesh::generate
