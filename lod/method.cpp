#include "lod/method.h"
