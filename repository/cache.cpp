#include "repository/cache.h"
