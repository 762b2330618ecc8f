/* How fast this processor does double precision arithmetic on 6x6 blocks that lie in its first cache.
   "one": one block after the other, each row padded to a vector of eight. "wide": eight blocks at once, one per lane.
   Each function repeats its work and returns a number that depends on all of it. */
#define N 6
#define BLOCKS 16
#define UNROLL _Pragma("GCC unroll 6")

typedef double lanes __attribute__((vector_size(64)));

/* c += a b */
double multiply_one(long repeats, const double (*a)[N][8], const lanes (*b)[N], lanes (*c)[N]) {
    for (long r = 0; r < repeats; r++)
        for (int q = 0; q < BLOCKS; q++) {
            lanes s[N];
            UNROLL for (int i = 0; i < N; i++) s[i] = c[q][i];
            UNROLL for (int k = 0; k < N; k++) {
                lanes row = b[q][k];
                UNROLL for (int i = 0; i < N; i++) s[i] += a[q][i][k] * row;
            }
            UNROLL for (int i = 0; i < N; i++) c[q][i] = s[i];
        }
    return c[0][0][0];
}

double multiply_wide(long repeats, const lanes (*a)[N][N], const lanes (*b)[N][N], lanes (*c)[N][N]) {
    for (long r = 0; r < repeats; r++)
        for (int q = 0; q < BLOCKS / 8; q++)
            for (int i = 0; i < N; i++) {
                lanes s[N];
                UNROLL for (int j = 0; j < N; j++) s[j] = c[q][i][j];
                UNROLL for (int k = 0; k < N; k++) {
                    lanes x = a[q][i][k];
                    UNROLL for (int j = 0; j < N; j++) s[j] += x * b[q][k][j];
                }
                UNROLL for (int j = 0; j < N; j++) c[q][i][j] = s[j];
            }
    return c[0][0][0][0];
}

/* l l' = a, lower triangles */
double cholesky_one(long repeats, const double (*a)[N][8], double (*l)[N][8]) {
    for (long r = 0; r < repeats; r++)
        for (int q = 0; q < BLOCKS; q++)
            UNROLL for (int j = 0; j < N; j++) {
                double d = a[q][j][j];
                for (int k = 0; k < j; k++) d -= l[q][j][k] * l[q][j][k];
                d = __builtin_sqrt(d);
                l[q][j][j] = d;
                double inverse = 1.0 / d;
                UNROLL for (int i = j + 1; i < N; i++) {
                    double s = a[q][i][j];
                    for (int k = 0; k < j; k++) s -= l[q][i][k] * l[q][j][k];
                    l[q][i][j] = s * inverse;
                }
            }
    return l[0][5][5];
}

static lanes root(lanes x) {
    for (int k = 0; k < 8; k++) x[k] = __builtin_sqrt(x[k]);
    return x;
}

double cholesky_wide(long repeats, const lanes (*a)[N][N], lanes (*l)[N][N]) {
    for (long r = 0; r < repeats; r++)
        for (int q = 0; q < BLOCKS / 8; q++)
            UNROLL for (int j = 0; j < N; j++) {
                lanes d = a[q][j][j];
                for (int k = 0; k < j; k++) d -= l[q][j][k] * l[q][j][k];
                d = root(d);
                l[q][j][j] = d;
                lanes inverse = 1.0 / d;
                UNROLL for (int i = j + 1; i < N; i++) {
                    lanes s = a[q][i][j];
                    for (int k = 0; k < j; k++) s -= l[q][i][k] * l[q][j][k];
                    l[q][i][j] = s * inverse;
                }
            }
    return l[0][5][5][0];
}
