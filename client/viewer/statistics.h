#pragma once
// The figures of the statistics overlay, as numbers and as lines of text.
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "client/viewer/accuracy.h"

namespace client {

std::string_view accuracyName(Accuracy accuracy);  ///< "blended"

struct Statistics {
  double frames_per_second = 0.0;      ///< over the last second; 0 at rest
  double frame_milliseconds = 0.0;     ///< time to draw one frame, smoothed; 0 when the platform gave no clock
  std::uint32_t images_in_use = 0;     ///< blended in the picture
  std::uint32_t images_resident = 0;   ///< on the GPU
  std::uint32_t images_requested = 0;  ///< received, and on their way to the GPU
  std::uint32_t patches = 0;
  std::uint64_t triangles = 0;
  std::uint64_t memory_bytes = 0, memory_budget = 0;  ///< everything that grows with the scene, on the GPU and off
  std::uint64_t gpu_bytes = 0;                        ///< part of memory_bytes: textures and buffers
  std::uint64_t received_bytes = 0;
  std::uint64_t received_images = 0, received_patches = 0, received_frames = 0;  ///< bytes by kind
  double megabits_per_second = 0.0;                                              ///< rate of the last second
  double round_trip_milliseconds = 0.0;  ///< from sending a view to the first answer; 0: not measured yet
  double error_px = 0.0;  ///< largest projected error of the drawn patches, or diameter of the drawn splats
  double hit_rate = 0.0;  ///< share of the images used by moving views that were here already, 0 … 1
  Accuracy accuracy = Accuracy::kNothing;
  std::uint64_t splats = 0;  ///< drawn
  double reduction = 1.0;    ///< pixels a side for each drawn sample
  double lens_px = 0.0;      ///< error_px inside the magnifying glass; 0 without one
  bool limited = false;      ///< memory does not allow finer splats
  std::uint64_t blocks = 0;  ///< blocks in the file of splats; 0: no splats are shown
  std::uint64_t blocks_present = 0, blocks_requested = 0, blocks_wanted = 0;
  bool complete = false;     ///< everything for this view is here and shown
  std::uint32_t broken = 0;  ///< images, groups and blocks that could not be decoded
  std::string last_fault;
};

struct StatisticsLine {
  std::string name;   ///< "images"
  std::string value;  ///< "12 in use, 30 resident, 2 requested"
};
std::vector<StatisticsLine> statisticsLines(const Statistics& statistics);

}  // namespace client
