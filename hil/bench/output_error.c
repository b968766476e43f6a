/* The arithmetic of hil/lab/identify/objective.py, output_error, as one would write it in C: one loop over the samples,
   one over the candidates that the compiler makes SIMD of. Built and timed by hil/bench/objective.py.

   candidates: rows ln K, ln T, alpha r^2 and delta0 of `count` columns each (the transpose of the points).
   work: 19 rows of count + 8 for what is carried along, at a multiple of 64 bytes. The rows lie 64 bytes further apart
   than they are long, so that no two share their address modulo 4096, which the processor would mistake for the same. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#define P2 (1.0 / 2)
#define P3 (1.0 / 6)
#define P4 (1.0 / 24)
#define P5 (1.0 / 120)
#define P6 (1.0 / 720)
#define P7 (1.0 / 5040)
#define P8 (1.0 / 40320)
#define S0 (1.0 / 2 - P2 + P3)
#define S1 (P2 / 2 - P3 + P4)
#define S2 (P3 / 2 - P4 + P5)
#define S3 (P4 / 2 - P5 + P6)
#define S4 (P5 / 2 - P6 + P7)
#define S5 (P6 / 2 - P7 + P8)
#define S6 (P7 / 2 - P8)
#define S7 (P8 / 2)
#define LEAST_DAMPING 0.05
#define TINY 1e-200
#define LARGEST_RATE 1e6

static inline double least(double a, double b) { return a < b ? a : b; }
static inline double most(double a, double b) { return a > b ? a : b; }

void output_error(ptrdiff_t count, ptrdiff_t rows, const double *restrict candidates, double *restrict values,
                  const double *restrict scales, const ptrdiff_t *restrict flags, const double *restrict step_s,
                  const double *restrict rudder, const double *restrict speed, const double *restrict heading,
                  const double *restrict yaw_rate, double *restrict work)
{
    const ptrdiff_t row = count + 8;
    double *restrict gain = work, *restrict lag = work + row, *restrict cubic = work + 2 * row;
    double *restrict offset = work + 3 * row, *restrict psi = work + 4 * row, *restrict r = work + 5 * row;
    double *restrict decay = work + 6 * row, *restrict turn = work + 7 * row, *restrict e1 = work + 8 * row;
    double *restrict t1 = work + 9 * row, *restrict e2 = work + 10 * row, *restrict t2 = work + 11 * row;
    double *restrict et = work + 12 * row, *restrict ht2 = work + 13 * row, *restrict het = work + 14 * row;
    double *restrict rt2 = work + 15 * row, *restrict ret = work + 16 * row;
    double *restrict he2 = work + 17 * row, *restrict re2 = work + 18 * row;
    const int with_heading = scales[4] > 0.0, with_rate = scales[5] > 0.0;
    ptrdiff_t inside = 0;

    memset(work, 0, 19 * (size_t)row * sizeof(double));
#pragma GCC ivdep
    for (ptrdiff_t f = 0; f < count; f++) {
        const double c = candidates[2 * count + f];
        gain[f] = scales[0] * exp(candidates[f]) * (1.0 + c);
        lag[f] = exp(candidates[count + f]) * (1.0 + c);
        cubic[f] = c / (scales[1] * scales[1]);
        offset[f] = scales[3] + candidates[3 * count + f] * scales[2] * (1.0 + 3.0 * c) / (1.0 + c);
        decay[f] = 1.0;
    }
    for (ptrdiff_t n = 0; n <= rows; n++) {
        if (n == rows || flags[n] > 0) {
            const double share = 1.0 / (double)(inside > 1 ? inside : 1);
#pragma GCC ivdep
            for (ptrdiff_t f = 0; f < count; f++) {
                he2[f] += e2[f] - share * e1[f] * e1[f];
                ht2[f] += t2[f] - share * t1[f] * t1[f];
                het[f] += et[f] - share * e1[f] * t1[f];
                e1[f] = t1[f] = e2[f] = t2[f] = et[f] = psi[f] = turn[f] = 0.0;
            }
            inside = 0;
        }
        if (n == rows || flags[n] == 2)
#pragma GCC ivdep
            for (ptrdiff_t f = 0; f < count; f++) {
                he2[f] -= het[f] * het[f] / most(ht2[f], TINY);
                re2[f] -= ret[f] * ret[f] / most(rt2[f], TINY);
                ht2[f] = het[f] = rt2[f] = ret[f] = r[f] = 0.0;
                decay[f] = 1.0;
            }
        else {
            const double u = 0.5 * (speed[n - 1] + speed[n]), lag_scale = 1.0 / u, cubic_scale = 1.0 / (u * u);
            const double from = rudder[n - 1], to = rudder[n], h = step_s[n];
#pragma GCC ivdep
            for (ptrdiff_t f = 0; f < count; f++) {
                const double T = lag[f] * lag_scale, K = gain[f] * u, a = cubic[f] * cubic_scale, rate = r[f];
                const double drag = rate + a * rate * rate * rate;
                const double start = (K * (from - offset[f]) - drag) / T, end = (K * (to - offset[f]) - drag) / T;
                const double ramp = end - start;
                const double x = h / T * most(1.0 + 3.0 * a * rate * rate, LEAST_DAMPING);
                const double growth =
                    1.0 + x * (1.0 + x * (P2 + x * (P3 + x * (P4 + x * (P5 + x * (P6 + x * (P7 + x * P8)))))));
                const double phi3 =
                    (S0 + x * (S1 + x * (S2 + x * (S3 + x * (S4 + x * (S5 + x * (S6 + x * S7))))))) / growth;
                const double phi2 = 0.5 - x * phi3, phi1 = 1.0 - x * phi2;
                psi[f] += h * (rate + h * (phi2 * start + phi3 * ramp));
                r[f] = least(most(rate + h * (phi1 * start + phi2 * ramp), -LARGEST_RATE), LARGEST_RATE);
                const double y = h / T, decayed = decay[f] / (1.0 + y * (1.0 + y * (P2 + y * P3)));
                turn[f] += 0.5 * h * (decay[f] + decayed);
                decay[f] = decayed;
            }
        }
        if (n == rows)
            break;
        if (with_heading)
#pragma GCC ivdep
            for (ptrdiff_t f = 0; f < count; f++) {
                const double error = heading[n] - psi[f];
                e1[f] += error;
                t1[f] += turn[f];
                e2[f] += error * error;
                t2[f] += turn[f] * turn[f];
                et[f] += error * turn[f];
            }
        if (with_rate)
#pragma GCC ivdep
            for (ptrdiff_t f = 0; f < count; f++) {
                const double error = yaw_rate[n] - r[f];
                rt2[f] += decay[f] * decay[f];
                ret[f] += error * decay[f];
                re2[f] += error * error;
            }
        inside++;
    }
#pragma GCC ivdep
    for (ptrdiff_t f = 0; f < count; f++) {
        const double by_heading = most(he2[f], 0.0) / (with_heading ? scales[4] : 1.0);
        const double by_rate = most(re2[f], 0.0) / (with_rate ? scales[5] : 1.0);
        values[f] = with_heading && with_rate ? sqrt(by_heading * by_rate) : with_heading ? by_heading : by_rate;
    }
}
