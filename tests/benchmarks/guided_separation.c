/* A separation by guided springs without cant, delay, gravity or envelope, as a plain loop: a yardstick for the package.

   Everything in platform axes; y is the axis of the guides. A state is d, w = d' (inertial), the rates of platform and
   satellite (each in its own axes) and the quaternion Q from satellite to platform axes: 16 numbers. The stroke of
   spring i, s_i = S + R_yx x_i + R_yz z_i, is linear in its seat (x_i, 0, z_i), so sums of K, K x, K x^2, ... over the
   springs that push are all that a slope needs; they change at a release.

   Steps: Dormand and Prince, order 8 (Hairer, Norsett, Wanner 1993, section II.5), whose stages stand in stages.h,
   written by the script that compiles this file; the classical order 4 where a stretch is short. Releases are
   predicted, stepped to, and corrected. */

#include <math.h>
#include <stddef.h>

#define SIZE 16
#define SPRINGS 16
#define HEAD 23  /* mass, tensor (xx yy zz xy xz yz) and CG of platform and satellite, then the rates of the stack */

typedef struct {
    double inverse_mass, i1[9], j1[9], i2[9], j2[9], c1y, c2[3];
    double k, kx, kz, kxx, kxz, kzz, f, fx, fz;  /* sums over active springs: of K, K x, ...; of K xi, K xi x, K xi z */
    double x[SPRINGS], z[SPRINGS], stiffness[SPRINGS], deformation[SPRINGS], stroke[SPRINGS];
    int active[SPRINGS], count;
    long slopes;
} Run;

static inline void times(const double *m, double x, double y, double z, double *out) {
    out[0] = m[0] * x + m[1] * y + m[2] * z;
    out[1] = m[3] * x + m[4] * y + m[5] * z;
    out[2] = m[6] * x + m[7] * y + m[8] * z;
}

static inline void turn(const double *q, double *r) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    r[0] = 1 - 2 * (y * y + z * z), r[1] = 2 * (x * y - w * z), r[2] = 2 * (x * z + w * y);
    r[3] = 2 * (x * y + w * z), r[4] = 1 - 2 * (x * x + z * z), r[5] = 2 * (y * z - w * x);
    r[6] = 2 * (x * z - w * y), r[7] = 2 * (y * z + w * x), r[8] = 1 - 2 * (x * x + y * y);
}

static void slope(Run *run, const double *restrict x, double *restrict k) {
    double r[9], h[3], a[3];
    const double *o1 = x + 6, *o2 = x + 9, *c2 = run->c2;
    run->slopes++;
    turn(x + 12, r);
    /* Total force along y, and the sum of each force times its seat from the satellite's CG, in satellite axes. */
    double s = x[1] - r[3] * c2[0] - r[4] * c2[1] - r[5] * c2[2] + run->c1y;
    double f = run->f - s * run->k - r[3] * run->kx - r[5] * run->kz;
    double bx = run->fx - s * run->kx - r[3] * run->kxx - r[5] * run->kxz - c2[0] * f;
    double bz = run->fz - s * run->kz - r[3] * run->kxz - r[5] * run->kzz - c2[2] * f;
    double by = -c2[1] * f;
    k[0] = x[3] - (o1[1] * x[2] - o1[2] * x[1]);
    k[1] = x[4] - (o1[2] * x[0] - o1[0] * x[2]);
    k[2] = x[5] - (o1[0] * x[1] - o1[1] * x[0]);
    k[3] = -(o1[1] * x[5] - o1[2] * x[4]);
    k[4] = run->inverse_mass * f - (o1[2] * x[3] - o1[0] * x[5]);
    k[5] = -(o1[0] * x[4] - o1[1] * x[3]);
    /* Platform: the moment -(d f + R b) x y. */
    double px = r[0] * bx + r[1] * by + r[2] * bz + x[0] * f, pz = r[6] * bx + r[7] * by + r[8] * bz + x[2] * f;
    times(run->i1, o1[0], o1[1], o1[2], h);
    a[0] = pz - (o1[1] * h[2] - o1[2] * h[1]);
    a[1] = -(o1[2] * h[0] - o1[0] * h[2]);
    a[2] = -px - (o1[0] * h[1] - o1[1] * h[0]);
    times(run->j1, a[0], a[1], a[2], k + 6);
    /* Satellite: b x y, with y in satellite axes. */
    times(run->i2, o2[0], o2[1], o2[2], h);
    a[0] = by * r[5] - bz * r[4] - (o2[1] * h[2] - o2[2] * h[1]);
    a[1] = bz * r[3] - bx * r[5] - (o2[2] * h[0] - o2[0] * h[2]);
    a[2] = bx * r[4] - by * r[3] - (o2[0] * h[1] - o2[1] * h[0]);
    times(run->j2, a[0], a[1], a[2], k + 9);
    double w = x[12], u = x[13], v = x[14], z = x[15];
    k[12] = 0.5 * (-u * (o2[0] - o1[0]) - v * (o2[1] - o1[1]) - z * (o2[2] - o1[2]));
    k[13] = 0.5 * (w * (o2[0] - o1[0]) + v * (o2[2] + o1[2]) - z * (o2[1] + o1[1]));
    k[14] = 0.5 * (w * (o2[1] - o1[1]) + z * (o2[0] + o1[0]) - u * (o2[2] + o1[2]));
    k[15] = 0.5 * (w * (o2[2] - o1[2]) + u * (o2[1] + o1[1]) - v * (o2[0] + o1[0]));
}

/* One step of order 8 from x, with its slope in k[0]; returns the error over the error allowed. */
static double eighth_order(Run *run, const double *restrict x, double h, const double *scale, double k[][SIZE], double *out) {
    double y[SIZE], e5, e3, fifth = 0, third = 0;
#include "stages.h"
    return fifth > 0 ? fabs(h) * fifth / sqrt((fifth + 0.01 * third) * SIZE) : 0;
}

/* One step of order 4 from x, with its slope in k[0]. */
static void fourth_order(Run *run, const double *x, double h, double k[][SIZE], double *out) {
    double y[SIZE];
    for (int n = 0; n < SIZE; n++) y[n] = x[n] + 0.5 * h * k[0][n];
    slope(run, y, k[1]);
    for (int n = 0; n < SIZE; n++) y[n] = x[n] + 0.5 * h * k[1][n];
    slope(run, y, k[2]);
    for (int n = 0; n < SIZE; n++) y[n] = x[n] + h * k[2][n];
    slope(run, y, k[3]);
    for (int n = 0; n < SIZE; n++) out[n] = x[n] + h / 6 * (k[0][n] + 2 * (k[1][n] + k[2][n]) + k[3][n]);
}

/* What is left of the stroke of spring i, its rate, and its acceleration but for terms of second order in the rates. */
static void gap(const Run *run, const double *x, const double *k, int i, double *left, double *rate, double *acceleration) {
    double r[9], b[3], o[3], a[3];
    turn(x + 12, r);
    times(r, run->x[i] - run->c2[0], -run->c2[1], run->z[i] - run->c2[2], b);
    times(r, x[9], x[10], x[11], o);
    times(r, k[9], k[10], k[11], a);
    *left = run->stroke[i] - (x[1] + b[1] + run->c1y);
    *rate = k[1] + (o[2] - x[8]) * b[0] - (o[0] - x[6]) * b[2];
    *acceleration = k[4] - (k[8] * x[0] - k[6] * x[2]) + (a[2] - k[8]) * b[0] - (a[0] - k[6]) * b[2];
}

static void sum_springs(Run *run) {
    run->k = run->kx = run->kz = run->kxx = run->kxz = run->kzz = run->f = run->fx = run->fz = 0;
    for (int i = 0; i < run->count; i++)
        if (run->active[i]) {
            double k = run->stiffness[i], f = k * run->deformation[i], x = run->x[i], z = run->z[i];
            run->k += k, run->kx += k * x, run->kz += k * z;
            run->kxx += k * x * x, run->kxz += k * x * z, run->kzz += k * z * z;
            run->f += f, run->fx += f * x, run->fz += f * z;
        }
}

static void tensor(const double *p, double *i, double *j) {
    double xx = p[0], yy = p[1], zz = p[2], xy = p[3], xz = p[4], yz = p[5];
    double a = yy * zz - yz * yz, b = xz * yz - xy * zz, c = xy * yz - xz * yy, d = xx * a + xy * b + xz * c;
    i[0] = xx, i[1] = i[3] = xy, i[2] = i[6] = xz, i[4] = yy, i[5] = i[7] = yz, i[8] = zz;
    j[0] = a / d, j[1] = j[3] = b / d, j[2] = j[6] = c / d, j[4] = (xx * zz - xz * xz) / d;
    j[5] = j[7] = (xy * xz - xx * yz) / d, j[8] = (xx * yy - xy * xy) / d;
}

/* The spring that reaches its stroke first, and when, by the slope alone; `all`: those that have not reached it too. */
static int first_release(const Run *run, const double *x, const double *k, int expected, double *time) {
    int spring = -1;
    *time = INFINITY;
    for (int i = 0; i < run->count; i++)
        if (run->active[i]) {
            double left, rate, acceleration;
            gap(run, x, k, i, &left, &rate, &acceleration);
            if ((left <= 0 || i == expected) && rate > 0 && left / rate < *time) *time = left / rate, spring = i;
        }
    return spring;
}

/* A run: p holds HEAD numbers and then angle, radius, stiffness, deformation and stroke of each spring. Writes w and the
   satellite's rates at the last release (6) and the release times. Returns the slopes computed, or -1. */
static long separate(const double *p, int count, double tolerance, double *motion, double *release) {
    Run run = {.count = count, .slopes = 0};
    double x[SIZE], y[SIZE], k[13][SIZE], scale[SIZE], arm1 = 0, arm2 = 0, shortest = INFINITY, speed = 0;
    const double *c1 = p + 7, *c2 = p + 17, *o = p + 20;
    run.inverse_mass = 1 / p[0] + 1 / p[10];
    tensor(p + 1, run.i1, run.j1);
    tensor(p + 11, run.i2, run.j2);
    run.c1y = c1[1];
    for (int n = 0; n < 3; n++) run.c2[n] = c2[n], x[n] = c2[n] - c1[n], x[6 + n] = x[9 + n] = o[n];
    x[3] = o[1] * x[2] - o[2] * x[1], x[4] = o[2] * x[0] - o[0] * x[2], x[5] = o[0] * x[1] - o[1] * x[0];
    x[12] = 1, x[13] = x[14] = x[15] = 0;
    for (int i = 0; i < count; i++) {
        const double *s = p + HEAD + 5 * i;
        run.x[i] = s[1] * cos(s[0]), run.z[i] = s[1] * sin(s[0]);
        run.stiffness[i] = s[2], run.deformation[i] = s[3], run.stroke[i] = fmin(s[4], s[3]), run.active[i] = 1;
        shortest = fmin(shortest, run.stroke[i]);
        speed += s[2] * run.stroke[i] * (2 * s[3] - run.stroke[i]);
        double x1 = run.x[i] - c1[0], z1 = run.z[i] - c1[2], x2 = run.x[i] - c2[0], z2 = run.z[i] - c2[2];
        arm1 = fmax(arm1, x1 * x1 + z1 * z1), arm2 = fmax(arm2, x2 * x2 + z2 * z2);
    }
    sum_springs(&run);
    speed = sqrt(speed * run.inverse_mass);
    double square = run.k * (run.inverse_mass + arm1 * fmax(run.j1[0], fmax(run.j1[4], run.j1[8]))
                             + arm2 * fmax(run.j2[0], fmax(run.j2[4], run.j2[8])));
    double frequency = sqrt(square + o[0] * o[0] + o[1] * o[1] + o[2] * o[2]);
    /* Below this length the error of a step of order 4, (w h)^5 / 120, is well below the tolerance. */
    double brief = pow(0.6 * tolerance, 0.2) / frequency, next = 2 * pow(tolerance, 0.125) / frequency, t = 0;
    for (int left_over = count, step = 0; left_over > 0; step++) {
        if (step > 500) return -1;
        slope(&run, x, k[0]);
        double target = INFINITY, omega = sqrt(run.k * run.inverse_mass), h, time;
        int expected = -1;
        for (int i = 0; i < count; i++)
            if (run.active[i]) {
                /* left = rate sin(wt) / w + acceleration (1 - cos(wt)) / w^2, as of one body on a spring. */
                double left, rate, acceleration;
                gap(&run, x, k[0], i, &left, &rate, &acceleration);
                double a = rate / omega, b = acceleration / (omega * omega), sine = (left - b) / sqrt(a * a + b * b);
                if (sine < 1) {
                    double due = fmax(0, (atan2(b, a) + asin(fmax(-1, sine))) / omega);
                    if (due < target) target = due, expected = i;
                }
            }
        for (int n = 0; n < 3; n++) {
            scale[n] = tolerance * shortest, scale[3 + n] = tolerance * (speed + fabs(x[3 + n]));
            scale[6 + n] = tolerance * (1e-3 + fabs(x[6 + n])), scale[9 + n] = tolerance * (1e-3 + fabs(x[9 + n]));
        }
        for (int n = 12; n < SIZE; n++) scale[n] = tolerance;
        int landing = target <= 1.3 * next, spring;
        h = landing ? target : next;
        for (int attempt = 0;; attempt++) {
            if (attempt > 40) return -1;
            if (h <= brief) {
                fourth_order(&run, x, h, k, y);
            } else {
                double ratio = eighth_order(&run, x, h, scale, k, y);
                if (!(ratio <= 1)) {
                    h *= fmax(0.2, 0.9 * pow(ratio, -0.125));
                    next = h, landing = 0;
                    continue;
                }
                double longer = h * (ratio > 0 ? fmin(6, 0.9 * pow(ratio, -0.125)) : 6);
                next = h >= next ? longer : fmax(next, longer);
            }
            slope(&run, y, k[12]);
            spring = first_release(&run, y, k[12], landing ? expected : -1, &time);
            if (spring >= 0 && time < -brief) {
                h += time, landing = 1, expected = spring;
                continue;
            }
            break;
        }
        t += h;
        for (int n = 0; n < SIZE; n++) x[n] = y[n];
        if (spring < 0 || time > brief) continue;
        for (int again = 0; again < 6; again++) {
            for (int n = 0; n < SIZE; n++) k[0][n] = k[12][n];
            if (fabs(time) * frequency < 1e-4) {
                for (int n = 0; n < SIZE; n++) y[n] = x[n] + 0.5 * time * k[0][n];
                slope(&run, y, k[1]);
                for (int twice = 0; twice < 2; twice++) {
                    for (int n = 0; n < SIZE; n++) x[n] += time * k[1][n];
                    t += time;
                    spring = first_release(&run, x, k[1], spring, &time);
                }
                break;
            }
            fourth_order(&run, x, time, k, x);
            t += time;
            slope(&run, x, k[12]);
            spring = first_release(&run, x, k[12], spring, &time);
        }
        run.active[spring] = 0, release[spring] = t, left_over--;
        sum_springs(&run);
    }
    for (int n = 0; n < 3; n++) motion[n] = x[3 + n], motion[3 + n] = x[9 + n];
    return run.slopes;
}

/* All runs, one after the other; returns the slopes computed in all, or -1. */
long separate_all(const double *p, size_t runs, int count, double tolerance, double *motion, double *release) {
    long slopes = 0;
    for (size_t i = 0; i < runs; i++) {
        long used = separate(p + i * (HEAD + 5 * count), count, tolerance, motion + 6 * i, release + count * i);
        if (used < 0) return -1;
        slopes += used;
    }
    return slopes;
}
