#include "mesh/generate/rooms_paint.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

using glm::dvec2;
using glm::dvec3;

const dvec3 kX(1.0, 0.0, 0.0), kY(0.0, 1.0, 0.0), kZ(0.0, 0.0, 1.0);
const dvec3 kPlaster(233.0, 231.0, 226.0);
const dvec3 kWoodwork(240.0, 238.0, 232.0);
constexpr double kSkirting = 0.09;    // metres
constexpr std::uint32_t kPieces = 2;  // of furniture in each room

/// Shade in the corners of a room, where less light comes, as far as a panel's borders are away.
double cornerShade(const RoomPanel& panel, const dvec2& st) {
  const dvec2 inside = glm::min(st - panel.low, panel.high - st);
  return 0.8 + 0.2 * smooth(0.0, 0.7, std::max(0.0, std::min(inside.x, inside.y)));
}

}  // namespace

RoomsPaint::RoomsPaint(std::uint64_t seed) : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32U)) * 0x9E3779B1U) {
  build();
}

void RoomsPaint::build() {
  // The walls of a room from the south on, against the clock; those with a door lead to the next room.
  const dvec3 s = kRoomSize;
  for (std::uint32_t room = 0; room < 4; ++room) {
    const bool is_east = room % 2 == 1, is_north = room / 2 == 1;
    const dvec3 low(is_east ? s.x + kRoomWall : 0.0, is_north ? s.y + kRoomWall : 0.0, 0.0);
    const dvec3 high = low + s;
    panels_.push_back({low, kX, kY, {0.0, 0.0}, {s.x, s.y}, RoomFinish::kFloor, room, 0});
    panels_.push_back({{low.x, high.y, s.z}, kX, -kY, {0.0, 0.0}, {s.x, s.y}, RoomFinish::kCeiling, room, 0});
    struct Side {
      dvec3 origin, right;
      double length;
      bool has_door;
    };
    const std::array<Side, 4> sides{{{{high.x, low.y, 0.0}, -kX, s.x, is_north},
                                     {{high.x, high.y, 0.0}, -kY, s.y, !is_east},
                                     {{low.x, high.y, 0.0}, kX, s.x, !is_north},
                                     {low, kY, s.y, is_east}}};
    for (std::uint32_t number = 0; number < 4; ++number) {
      const Side& side = sides[number];
      const double door = 0.5 * (side.length - kDoorWidth), behind = side.length - door;
      const auto add = [&](const dvec2& from, const dvec2& to) {
        panels_.push_back({side.origin, side.right, kZ, from, to, RoomFinish::kWall, room, number});
      };
      Wall& wall = walls_[4 * room + number];
      wall.has_door = side.has_door;
      if (!side.has_door) {
        add({0.0, 0.0}, {side.length, s.z});
      } else {
        add({0.0, 0.0}, {door, s.z});
        add({behind, 0.0}, {side.length, s.z});
        add({door, kDoorHeight}, {behind, s.z});
      }
      hang(wall, 4 * room + number);
      for (Sign sign : wall.lettering.signs()) {
        sign.corner = side.origin + sign.corner.x * side.right + sign.corner.y * kZ;
        const dvec2 right(sign.right), up(sign.up);
        sign.right = right.x * side.right + right.y * kZ;
        sign.up = up.x * side.right + up.y * kZ;
        signs_.push_back(std::move(sign));
      }
      // Each door's sides, lintel and threshold are of the room from which it leads on.
      if (!side.has_door || number == 0 || number == 3) continue;
      const dvec3 through = number == 1 ? kX : kY;
      const dvec3 left = side.origin + door * side.right, right = side.origin + behind * side.right;
      const auto jamb = [&](const dvec3& origin, const dvec3& across, const dvec3& up, double height) {
        panels_.push_back({origin, across, up, {0.0, 0.0}, {kRoomWall, height}, RoomFinish::kJamb, room, number});
      };
      jamb(left, through, kZ, kDoorHeight);
      jamb(right + kRoomWall * through, -through, kZ, kDoorHeight);
      jamb(left + kDoorHeight * kZ, through, side.right, kDoorWidth);
      jamb(right, through, -side.right, kDoorWidth);
    }
    furnish(room, dvec2(low));
  }
}

// Pieces stand in opposite corners of a room, aside from its doors.
void RoomsPaint::furnish(std::uint32_t room, const dvec2& corner) {
  for (std::uint32_t piece = 0; piece < kPieces; ++piece) {
    const std::uint32_t number = kPieces * room + piece;
    const std::uint32_t h = latticeHash(number, 5, 1, seed_);
    const dvec3 size(0.7 + 0.7 * part(h, 0), 0.5 + 0.4 * part(h, 8), 0.4 + 0.9 * part(h, 16));
    const dvec2 free = dvec2(kRoomSize) - dvec2(size) - 0.3;
    const dvec2 place = piece == 0 ? corner + 0.15 : corner + 0.15 + free;
    const dvec3 low(place, 0.0), high = low + size;
    const auto add = [&](const dvec3& origin, const dvec3& right, const dvec3& up, double width, double height) {
      panels_.push_back({origin, right, up, {0.0, 0.0}, {width, height}, RoomFinish::kFurniture, room, number});
    };
    add({low.x, low.y, high.z}, kX, kY, size.x, size.y);
    add(low, kX, kZ, size.x, size.z);
    add({high.x, low.y, 0.0}, kY, kZ, size.y, size.z);
    add({high.x, high.y, 0.0}, -kX, kZ, size.x, size.z);
    add({low.x, high.y, 0.0}, -kY, kZ, size.y, size.z);
  }
}

// Pictures and lines of text, beside the door where there is one.
void RoomsPaint::hang(Wall& wall, std::uint32_t number) {
  const double length = number % 2 == 0 ? kRoomSize.x : kRoomSize.y;
  const std::uint32_t h = latticeHash(number, 7, 2, seed_);
  const auto picture = [&](double middle, double width, std::uint32_t salt) {
    const double height = width * (0.6 + 0.5 * part(h, salt % 24U));
    const double low = 1.62 - 0.5 * height;
    wall.pictures.push_back({{middle - 0.5 * width, low}, {middle + 0.5 * width, low + height}, h + salt});
    const std::string text = "NO. " + std::to_string(1 + (h + salt) % 89U) + " " + randomText(h + salt, 8);
    wall.lettering.add(text, {middle - 0.42, low - 0.2, 0.0}, 0.06);
  };
  const double aside = 0.25 * (length - kDoorWidth);
  picture(aside, 0.8 + 0.4 * part(h, 0), 1U);
  picture(length - aside, 0.8 + 0.4 * part(h, 8), 2U);
  if (!wall.has_door) {
    // A chart of lines, each lower than the one above, shows how fine a picture is.
    constexpr std::array<double, 6> kHeights{0.12, 0.08, 0.055, 0.036, 0.024, 0.016};
    double feet = 1.9;
    for (std::size_t i = 0; i < kHeights.size(); ++i) {
      const auto letters = static_cast<std::size_t>((0.66 * 7.0 / kHeights[i] + 1.0) / 6.0);
      const double width = (6.0 * static_cast<double>(letters) - 1.0) * kHeights[i] / 7.0;
      feet -= 1.9 * kHeights[i];
      const std::string text = randomText(h + 31U * static_cast<std::uint32_t>(i), letters);
      wall.lettering.add(text, {0.5 * (length - width), feet, 0.0}, kHeights[i]);
    }
  }
  wall.lettering.finish({length, kRoomSize.z});
}

double RoomsPaint::noise(const dvec2& p, double wavelength, double texel, std::uint32_t salt) const {
  const double seen = resolved(wavelength, texel);
  return seen > 0.0 ? seen * valueNoise(p / wavelength, seed_ + salt) : 0.0;
}

dvec3 RoomsPaint::planks(const dvec2& p, double texel, std::uint32_t room) const {
  constexpr double kWidth = 0.11, kLength = 1.3;
  const std::int64_t row = floorToInt(p.y / kWidth);
  const double along = p.x + kLength * part(latticeHash(row, room, 3, seed_), 0);
  const std::int64_t plank = floorToInt(along / kLength);
  const std::uint32_t h = latticeHash(row, plank, room, seed_);
  const dvec3 wood = blend(dvec3(168.0, 122.0, 78.0), dvec3(126.0, 84.0, 50.0), part(h, 0));
  const dvec2 grain(p.x * 0.08 + part(h, 8), p.y);
  double light = 0.92 + 0.16 * part(h, 16) + 0.10 * noise(grain, 0.011, texel, h & 63U) +
                 0.06 * noise(grain, 0.004, texel, 64U + (h & 63U));
  const dvec2 in(along - kLength * static_cast<double>(plank), p.y - kWidth * static_cast<double>(row));
  const double joint = std::min(std::min(in.x, kLength - in.x), std::min(in.y, kWidth - in.y));
  light *= 1.0 - 0.55 * coverage(0.0018 - joint, texel);
  return wood * light;
}

// Wallpaper of stripes or of a motif.
dvec3 RoomsPaint::paper(const dvec2& p, double texel, std::uint32_t room) const {
  const std::uint32_t h = latticeHash(room, 11, 4, seed_);
  const dvec3 base(160.0 + 60.0 * part(h, 0), 160.0 + 60.0 * part(h, 8), 150.0 + 60.0 * part(h, 16));
  const dvec3 other = blend(base, kPlaster, 0.5) - 22.0;
  constexpr double kPeriod = 0.18;
  double share = 0.0;
  if (room % 2 == 0) {
    const double at = std::abs(p.x / kPeriod - static_cast<double>(floorToInt(p.x / kPeriod)) - 0.5) * kPeriod;
    share = coverage(0.25 * kPeriod - at, texel);
  } else {
    const dvec2 cell(static_cast<double>(floorToInt(p.x / kPeriod)), static_cast<double>(floorToInt(p.y / kPeriod)));
    const dvec2 q = glm::abs(p - kPeriod * (cell + 0.5));
    share = std::max(coverage(0.035 - q.x - q.y, texel), coverage(0.004 - std::abs(q.x + q.y - 0.06), texel));
  }
  const double worn = 1.0 + 0.02 * noise(p, 0.6, texel, 21U) + 0.03 * noise(p, 0.006, texel, 22U);
  return blend(base, other, share) * worn;
}

// Clouds of colour over a horizon, with a brush's strokes.
dvec3 RoomsPaint::painting(const Picture& picture, const dvec2& p, double texel) const {
  constexpr double kFrame = 0.035;
  const dvec2 size = picture.high - picture.low;
  const dvec2 q = p - picture.low;
  const double inside = std::min(std::min(q.x, size.x - q.x), std::min(q.y, size.y - q.y)) - kFrame;
  const dvec3 frame = dvec3(74.0, 50.0, 30.0) * (1.0 + 0.2 * noise({4.0 * p.x, p.y}, 0.02, texel, picture.salt));
  if (inside <= -0.5 * texel) return frame;
  const double horizon =
      size.y * (0.35 + 0.25 * part(picture.salt, 4)) + 0.05 * noise(p, 0.35, texel, picture.salt + 1);
  const dvec3 sky = blend({196.0, 208.0, 220.0}, {70.0, 118.0, 190.0}, smooth(horizon, size.y, q.y));
  const dvec3 land = blend({70.0, 104.0, 50.0}, {168.0, 150.0, 84.0}, smooth(0.0, horizon, q.y));
  dvec3 color = blend(land, sky, coverage(q.y - horizon, texel));
  double wavelength = 0.4, amount = 34.0;
  for (std::uint32_t octave = 0; octave < 7; ++octave) {
    const std::uint32_t salt = picture.salt + 8U * octave;
    color += amount * dvec3(noise(p, wavelength, texel, salt + 2), noise(p, wavelength, texel, salt + 3),
                            noise(p, wavelength, texel, salt + 4));
    wavelength *= 0.5;
    amount *= 0.8;
  }
  return blend(frame, glm::clamp(color, dvec3(8.0), dvec3(248.0)), coverage(inside, texel));
}

dvec3 RoomsPaint::cloth(const dvec2& p, double texel, std::uint32_t number) const {
  const std::uint32_t h = latticeHash(number, 13, 6, seed_);
  const dvec3 dye(60.0 + 150.0 * part(h, 0), 60.0 + 130.0 * part(h, 8), 60.0 + 130.0 * part(h, 16));
  const double weave =
      0.10 * noise({p.x, 0.3 * p.y}, 0.005, texel, 31U) + 0.10 * noise({0.3 * p.x, p.y}, 0.005, texel, 32U);
  return dye * (1.0 + weave + 0.08 * noise(p, 0.12, texel, 33U));
}

dvec3 RoomsPaint::color(const RoomPanel& panel, const dvec2& st, double texel) const {
  const double shade = cornerShade(panel, st);
  switch (panel.finish) {
    case RoomFinish::kFloor:
      return shade * planks(st, texel, panel.room);
    case RoomFinish::kCeiling:
      return shade * kPlaster * (1.0 + 0.02 * noise(st, 0.9, texel, 41U) + 0.03 * noise(st, 0.012, texel, 42U));
    case RoomFinish::kJamb:
      return kWoodwork * (0.9 + 0.02 * noise(st, 0.02, texel, 43U));
    case RoomFinish::kFurniture:
      return shade * cloth(st, texel, panel.number);
    case RoomFinish::kWall:
      break;
  }
  const Wall& wall = walls_[wallNumber(panel)];
  dvec3 color = paper(st, texel, panel.room);
  color = blend(color, kWoodwork * 0.95, coverage(kSkirting - st.y, texel));
  for (const Picture& picture : wall.pictures)
    if (const double share = coverage(st, picture.low, picture.high, texel); share > 0.0)
      color = blend(color, painting(picture, st, texel), share);
  // Shade darkens letters with their boards, and not so far that they are hard to read.
  return (0.5 + 0.5 * shade) * wall.lettering.paint(color, st, texel);
}

dvec3 RoomsPaint::colorAt(const dvec3& point, double texel) const {
  const RoomPanel* nearest = &panels_.front();
  double least = 1e9;
  for (const RoomPanel& panel : panels_) {
    const dvec3 from = point - panel.origin;
    const dvec2 st(glm::dot(from, panel.right), glm::dot(from, panel.up));
    const double off = glm::length(point - panel.at(glm::clamp(st, panel.low, panel.high)));
    if (off >= least) continue;
    least = off;
    nearest = &panel;
  }
  const dvec3 from = point - nearest->origin;
  return color(*nearest, {glm::dot(from, nearest->right), glm::dot(from, nearest->up)}, texel);
}

double RoomsPaint::evenness(const RoomPanel& panel, const dvec2& st) const {
  if (panel.finish != RoomFinish::kWall) return 0.0;
  return walls_[wallNumber(panel)].lettering.nearness(st, 0.25).share;
}

std::unique_ptr<SurfacePaint> makeRoomsPaint(std::uint64_t seed) {
  return std::make_unique<RoomsPaint>(seed);
}

}  // namespace mesh::generate
