#include "clock.h"

bs_result clock_interval(const bs_settings *settings, double time, double before, double *interval, bool *fresh) {
    double past = time - before;
    if (!isfinite(time) || past <= 0) return BS_TIME_DISORDERED;
    *fresh = !(past <= settings->longest_gap); /* also before the first frame: NaN compares false */
    *interval = *fresh ? settings->first : fmin(past, settings->longest);
    return BS_OK;
}
