#include "lod/pmr/stream.h"
