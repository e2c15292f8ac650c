#include "lod/pmr/check_file.h"
