/* The problem "linear" of `stochvi problems`, in C: an oscillator in white noise without stops.

   x'' + 0.1 x' + x = w(t),  E w(t) w(t + tau) = 0.2 delta(tau),  from rest; 120 s are left out and
   400 s counted, in 1024 paths. Prints the averages of each path as CSV. An argument replaces the
   intensity 0.2, for a wrong one.

   cc -O2 linear.c -lm -o linear && ./linear > linear.csv && stochvi judge linear.csv --problem linear */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static uint64_t state = 1; /* splitmix64 */

static double uniform(void) {
    uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return ((double)((z ^ (z >> 31)) >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void) { /* Box and Muller */
    return sqrt(-2.0 * log(uniform())) * cos(6.283185307179586 * uniform());
}

int main(int count, char **words) {
    const double damping = 0.1, stiffness = 1.0, burn_in = 120.0, duration = 400.0, h = 0.02;
    const double intensity = count > 1 ? atof(words[1]) : 0.2;
    const double kept = exp(-damping * h);
    const double kick = sqrt(intensity / (2.0 * damping) * (1.0 - kept * kept));
    const long first = lround(burn_in / h), steps = lround(duration / h);
    puts("displacement_mean,displacement_mean_square,velocity_mean_square");
    for (int path = 0; path < 1024; path++) {
        double x = 0.0, v = 0.0, mean = 0.0, square = 0.0, speed = 0.0;
        for (long step = 0; step < first + steps; step++) {
            v -= 0.5 * h * stiffness * x; /* half a kick of the spring, half a flight */
            x += 0.5 * h * v;
            v = kept * v + kick * normal(); /* damping and noise, exactly */
            x += 0.5 * h * v;
            v -= 0.5 * h * stiffness * x;
            if (step >= first) {
                mean += x / steps;
                square += x * x / steps;
                speed += v * v / steps;
            }
        }
        printf("%.10g,%.10g,%.10g\n", mean, square, speed);
    }
    return 0;
}
