#pragma once
// The metrics of the process, under the names that Prometheus's own libraries use.
#include "server/metrics/metrics.h"

namespace server {

/// process_resident_memory_bytes, process_cpu_seconds_total, process_open_fds, process_max_fds,
/// process_start_time_seconds, process_threads, and lumigrid_build_info with the program's version.
void addProcessMetrics(Metrics& metrics);

}  // namespace server
