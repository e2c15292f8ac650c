#include "client/app/gesture.h"

#include <algorithm>
#include <cmath>

namespace client {
namespace {

bool pans(const PointerEvent& event) {
  return event.button != PointerButton::kLeft || event.modifiers.shift;
}

}  // namespace

/// Radius in which a press may tremble and still be a click: wider for fingers and pens than for mice.
double GestureReader::slop(PointerKind kind) const {
  constexpr double kMouse = 3.0, kFinger = 8.0;  // screen units
  return ratio_ * (kind == PointerKind::kMouse ? kMouse : kFinger);
}

GestureReader::Pointer* GestureReader::find(int id) {
  for (Pointer& pointer : pointers_)
    if (pointer.first.id == id) return &pointer;
  return nullptr;
}

void GestureReader::down(const PointerEvent& event) {
  if (find(event.id) != nullptr) return;  // a second button of the same mouse is ignored
  pointers_.push_back({event, event.x, event.y});
  if (pointers_.size() == 2) beginPair();
}

/// Starts a gesture of two fingers; neither is a click or a drag of its own any more.
void GestureReader::beginPair() {
  for (Pointer& pointer : pointers_) pointer.clickable = false;
  pair_grabbed_ = false;
  pair_distance_ = 0.0;
}

std::vector<Gesture> GestureReader::move(const PointerEvent& event) {
  Pointer* pointer = find(event.id);
  if (pointer == nullptr) return {};
  const double dx = event.x - pointer->x;
  const double dy = event.y - pointer->y;
  pointer->x = event.x;
  pointer->y = event.y;
  if (pointers_.size() >= 2) return movePair();

  // A drag begins at the edge of the circle.
  const PointerEvent& first = pointer->first;
  const PointerKind kind = first.kind;
  if (!pointer->dragging) {
    if (std::hypot(event.x - first.x, event.y - first.y) <= slop(kind)) return {};
    pointer->dragging = true;
    pointer->clickable = false;
    if (!pans(first)) return {};
    return {{.kind = GestureKind::kGrab, .x = event.x, .y = event.y, .pointer = kind}};
  }
  if (pans(first)) return {{.kind = GestureKind::kPan, .x = event.x, .y = event.y, .pointer = kind}};
  return {{.kind = GestureKind::kOrbit, .x = event.x, .y = event.y, .dx = dx, .dy = dy, .pointer = kind}};
}

std::vector<Gesture> GestureReader::movePair() {
  constexpr double kMinSpread = 8.0;  // pixels: without it, fingers on one spot would magnify without end
  const Pointer& a = pointers_[0];
  const Pointer& b = pointers_[1];
  const PointerKind kind = a.first.kind;
  const double x = 0.5 * (a.x + b.x);
  const double y = 0.5 * (a.y + b.y);
  const double distance = std::max(std::hypot(a.x - b.x, a.y - b.y), kMinSpread * ratio_);
  if (!pair_grabbed_) {
    pair_grabbed_ = true;
    pair_distance_ = distance;
    return {{.kind = GestureKind::kGrab, .x = x, .y = y, .pointer = kind}};
  }
  std::vector<Gesture> gestures{{.kind = GestureKind::kPan, .x = x, .y = y, .pointer = kind}};
  if (distance != pair_distance_)
    gestures.push_back(
        {.kind = GestureKind::kPinch, .x = x, .y = y, .factor = distance / pair_distance_, .pointer = kind});
  pair_distance_ = distance;
  return gestures;
}

void GestureReader::cancel(int id) {
  std::erase_if(pointers_, [id](const Pointer& pointer) { return pointer.first.id == id; });
  // The finger that is left of two, or the two that are left of three, start from where they are.
  if (pointers_.size() >= 2) beginPair();
  if (pointers_.size() != 1) return;
  Pointer& left = pointers_.front();
  if (left.clickable || left.dragging) return;
  left.first.x = left.x;
  left.first.y = left.y;
}

std::vector<Gesture> GestureReader::up(const PointerEvent& event) {
  const Pointer* found = find(event.id);
  if (found == nullptr) return {};
  const Pointer pointer = *found;
  cancel(event.id);
  const PointerEvent& first = pointer.first;
  constexpr double kClickSeconds = 0.5;  // a longer press is no click
  const bool click = pointer.clickable && first.button == PointerButton::kLeft &&
                     event.now - first.now <= kClickSeconds &&
                     std::hypot(event.x - first.x, event.y - first.y) <= slop(first.kind);
  if (!click) return {};

  constexpr double kDoubleSeconds = 0.35;
  constexpr double kDoubleSlops = 3.0;  // largest distance between the two clicks of a double click
  const bool again = event.now - last_click_ <= kDoubleSeconds &&
                     std::hypot(event.x - last_click_x_, event.y - last_click_y_) <= kDoubleSlops * slop(first.kind);
  last_click_ = again ? -1e9 : event.now;  // a third click starts over
  last_click_x_ = event.x;
  last_click_y_ = event.y;
  return {{.kind = again ? GestureKind::kDoubleClick : GestureKind::kClick,
           .x = first.x,
           .y = first.y,
           .pointer = first.kind}};
}

}  // namespace client
