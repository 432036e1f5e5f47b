/* The quadratic program of the real-time iteration in C, for any sizes of the problem.
 *
 * It is called by `kernel.py`, and given the sizes of the model and of its memory by -D: NX, NU,
 * LOCAL_*, MAX_*. Without it PIQP solves the same program (`qp.py`).
 *
 * The variables are steps from the iterate, dx_1..dx_N (10 each) and w_i = du_i (4 each), and a
 * slack s >= 0 for each margin of each stage. With v_i = w_i - w_{i-1}:
 *
 *   minimise  sum of stage costs + sum of penalty s + quadratic s^2/2
 *   subject   dx_{i+1} = A dx_i + B w_i + gap,  bounds on w_i and v_i,
 *             margin + slope . dp_{i+1} + s >= 0 for each row.
 *
 * The method is Mehrotra's predictor-corrector (1992). For a constraint a.y + h = t >= 0 with
 * multiplier l, the Newton system is that of an equality-constrained quadratic program with Hessian
 * H + (l/t) a a' and gradient g - a ((target - correction)/t + l - (l/t) h); its solution is the
 * next y itself. A slack is in one margin alone, so that it is eliminated by a division; the rest
 * by a Riccati recursion over (dx_i, w_{i-1}). All residuals shrink by (1 - step length), so that their product measures the
 * infeasibility. No branch depends on a clock, and the order of operations is fixed.
 *
 * Inside the kernel a state is three vectors of four, position, velocity, attitude, the fourth
 * place of the first two empty; w is a vector. Position and velocity are a double integrator in
 * every linearisation, so that only the columns of attitude and w in [A B] are multiplied by. The
 * constraints of a stage are in whole vectors too; what fills these has no slope and no multiplier.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

#define PLACE(n) ((n) < 3 ? (n) : (n) < 6 ? (n) + 1 : (n) + 2) /* of state n in the vectors */
#define EMPTY(place) ((place) == 3 || (place) == 7)
#define PX 12     /* places of a state */
#define PZ 16     /* places of a state and w */
#define DENSE 8   /* places of attitude and w */
#define BOUNDS 16 /* w lower, w upper, v lower, v upper */
#define MAX_CONSTRAINTS (BOUNDS + 2 * MAX_ROWS)
#define MAX_ITERATIONS 40
#define NOTHING 1e-200 /* multiplier of what only fills a vector */
/* Room of constraints at the first point, by how far others are broken there. Little room is soon
 * used up where the step is large; much has to be taken away again where it is small. */
#define LEAST_ROOM 0.03
#define MOST_ROOM 0.3
#define LEAST_SLACK 1e-3 /* m, at the first point */
/* Rows with more room [m] than any step of the iterate can use up are left out. */
#define OUT_OF_REACH 6.0

/* As many numbers at once as the machine's vectors hold; wider ones compilers split badly. */
#ifdef __AVX__
#define WIDTH 4
#else
#define WIDTH 2
#endif
typedef double Lanes __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));
#define AT(array, n) (((Lanes *)(array))[n])

_Static_assert(NU == 4 && NX == 10, "vectors of four are written out for these");
_Static_assert(MAX_ROWS % 4 == 0, "rows are filled up to whole vectors");

typedef struct {
    double F[PX][DENSE];  /* [A B], columns of attitude and w */
    double Ft[DENSE][PX]; /* its transpose */
    double Pb[PZ];        /* P (gap, 0) */
    double L[NU][NU];     /* Cholesky factor of the Hessian of w, lower; diagonal inverted */
    double Y[NU][PZ];     /* its inverse times the rest of the rows of w */
    double Kt[PZ][NU];    /* w = -K (dx, w_before) - k; the transpose of K */
    double gap[PX];
    double Hx[PX][PX], gx[PX];
    double He[NU], ge[NU];         /* effort */
    double Hr[NU], gr[NU];         /* change */
    double slope[MAX_ROWS][4];     /* of each row */
    double along[3][MAX_ROWS];     /* the same by direction */
    int rows;                      /* in reach, filled up to whole vectors */
    int row[MAX_ROWS];             /* which margin it is */
    int constraints;               /* BOUNDS, rows, their slacks */
    double kept[MAX_CONSTRAINTS];  /* multipliers of the last solution: bounds, margins, slacks */
    double deep[MAX_ROWS];         /* slacks of the last solution, by margin */
    double real[MAX_CONSTRAINTS];  /* 0 for what only fills a vector */
    double a[MAX_CONSTRAINTS];     /* offset h of each constraint */
    double t[MAX_CONSTRAINTS], l[MAX_CONSTRAINTS];
    double inverse[MAX_CONSTRAINTS]; /* 1 / t */
    double gamma[MAX_CONSTRAINTS], push[MAX_CONSTRAINTS];
    double dt[MAX_CONSTRAINTS], dl[MAX_CONSTRAINTS];
    double by_Hs[MAX_ROWS], gs[MAX_ROWS];    /* of slacks: 1 / Hessian, gradient */
    double x[PX], w[NU], s[MAX_ROWS];        /* the point: dx_{i+1}, w_i, slacks */
    double xn[PX], wn[NU], sn[MAX_ROWS];     /* the next point */
    double R[NU], r[NU];                     /* change cost with its barrier */
} Stage;

/* A sparse matrix inside a stage's column of `source`; `kernel.py` has the same structure. */
typedef struct {
    int offset; /* entry n is at offset + n */
    int count;
    const int *rows;
    const int *columns;
} Piece;

/* The quadratic program; `kernel.py` has the same structure. */
typedef struct {
    int N;            /* stages */
    int column;       /* numbers of a stage in `source` */
    int rows;         /* margins of a stage */
    int agents;       /* how many of them, the first, are of neighbours */
    int agent_stages; /* stages that keep away from neighbours */
    Piece gap;
    Piece dynamics;
    Piece gradient;
    Piece hessian;
    Piece margin;
    Piece slope;
    double low[NU];    /* (35), (36) */
    double high[NU];
    double change[NU]; /* (33), (34) */
    double dt;         /* of a stage [s] */
    double penalty;
    double quadratic;
    double tolerance;
    double complementarity; /* t l of the first point */
    int again;              /* begin at slacks and multipliers of the last solution */
    const double *source; /* N columns: the linearisation */
    const double *u;      /* N x NU: the iterate */
    const double *u_last; /* NU: the input before */
    void *work;           /* N * stage_bytes() */
    double *dx;           /* N x NX: steps of x_1..x_N, the answer */
    double *du;           /* N x NU: steps of u */
} Program;

size_t stage_bytes(void) { return sizeof(Stage); }

/* Set the rows in reach, margins from..p->rows. */
static void load_rows(const Program *p, Stage *g, const double *column, int from) {
    double dense[MAX_ROWS][3];
    memset(dense, 0, p->rows * sizeof dense[0]);
    for (int n = 0; n < p->slope.count; n++)
        dense[p->slope.rows[n]][p->slope.columns[n]] = column[p->slope.offset + n];
    int n = 0;
    for (int row = from; row < p->rows; row++) {
        double margin = column[p->margin.offset + row];
        if (margin > OUT_OF_REACH) continue;
        for (int d = 0; d < 3; d++) g->slope[n][d] = g->along[d][n] = dense[row][d];
        g->slope[n][3] = 0.0;
        g->row[n] = row;
        g->real[BOUNDS + n] = 1.0;
        g->a[BOUNDS + n++] = margin;
    }
    for (; n % 4; n++) {
        memset(g->slope[n], 0, sizeof g->slope[n]);
        for (int d = 0; d < 3; d++) g->along[d][n] = 0.0;
        g->real[BOUNDS + n] = 0.0;
        g->a[BOUNDS + n] = 1.0;
    }
    g->rows = n;
    g->constraints = BOUNDS + 2 * n;
    const double *real = g->real + BOUNDS;
    for (int k = 0; k < n; k++) {
        g->real[BOUNDS + n + k] = real[k];
        g->a[BOUNDS + n + k] = 1.0 - real[k];
    }
}

/* Set the data of all stages. */
static void load(const Program *p, Stage *stages) {
    const double *u = p->u;
    for (int i = 0; i < p->N; i++) {
        Stage *g = stages + i;
        const double *c = p->source + (size_t)i * p->column;
        memset(g->F, 0, sizeof g->F);
        memset(g->Ft, 0, sizeof g->Ft);
        memset(g->Hx, 0, sizeof g->Hx);
        memset(g->gx, 0, sizeof g->gx);
        memset(g->gap, 0, sizeof g->gap);
        for (int n = 0; n < p->dynamics.count; n++) {
            int row = PLACE(p->dynamics.rows[n]), column = PLACE(p->dynamics.columns[n]) - 8;
            if (column >= 0) g->F[row][column] = g->Ft[column][row] = c[p->dynamics.offset + n];
        }
        double hu[NU] = {0}, hb[NU] = {0};
        for (int n = 0; n < p->hessian.count; n++) {
            int r = p->hessian.rows[n], k = p->hessian.columns[n];
            double h = c[p->hessian.offset + n];
            if (r >= LOCAL_NEXT && k >= LOCAL_NEXT) {
                int row = PLACE(r - LOCAL_NEXT), column = PLACE(k - LOCAL_NEXT);
                g->Hx[row][column] = g->Hx[column][row] = h;
            } else if (r == k && r >= LOCAL_U && r < LOCAL_U + NU) hu[r - LOCAL_U] = h;
            else if (r == k && r >= LOCAL_BEFORE && r < LOCAL_BEFORE + NU)
                hb[r - LOCAL_BEFORE] = h;
        }
        const double *gradient = c + p->gradient.offset;
        for (int n = 0; n < NX; n++) {
            g->gap[PLACE(n)] = c[p->gap.offset + n];
            g->gx[PLACE(n)] = gradient[LOCAL_NEXT + n];
        }
        for (int n = 0; n < NU; n++) {
            double b = gradient[LOCAL_BEFORE + n];
            g->He[n] = hu[n] - hb[n];
            g->Hr[n] = hb[n];
            g->ge[n] = gradient[LOCAL_U + n] + b;
            g->gr[n] = -b;
            double here = u[i * NU + n], v = here - (i ? u[(i - 1) * NU + n] : p->u_last[n]);
            g->a[n] = here - p->low[n];
            g->a[4 + n] = p->high[n] - here;
            g->a[8 + n] = p->change[n] + v;
            g->a[12 + n] = p->change[n] - v;
        }
        for (int n = 0; n < BOUNDS; n++) g->real[n] = 1.0;
        load_rows(p, g, c, i < p->agent_stages ? 0 : p->agents);
    }
}

/* sum += weight * row, of `count` numbers. */
static inline void add(Lanes *sum, double weight, const double *row, int count) {
    for (int v = 0; v < count / WIDTH; v++) sum[v] += weight * AT(row, v);
}

static inline void put(double *out, const Lanes *in, int count) {
    for (int v = 0; v < count / WIDTH; v++) AT(out, v) = in[v];
}

/* Values a.y of all constraints of a stage at (x, w, s) with w_before. */
static inline void values(const Stage *g, const double *x, const double *w, const double *s,
                          const double *before, double *out) {
    for (int n = 0; n < NU / WIDTH; n++) {
        Lanes here = AT(w, n), change = here - AT(before, n);
        AT(out, n) = here, AT(out + 4, n) = -here, AT(out + 8, n) = change, AT(out + 12, n) = -change;
    }
    double *slacks = out + BOUNDS + g->rows;
    for (int n = 0; n < g->rows / WIDTH; n++) {
        AT(out + BOUNDS, n) = AT(g->along[0], n) * x[0] + AT(g->along[1], n) * x[1] +
                              AT(g->along[2], n) * x[2] + AT(s, n);
        AT(slacks, n) = AT(s, n);
    }
}

/* Stage Hessian (with barrier) into P, and the parts that depend on gamma only. */
static inline void add_hessian(Stage *g, double quadratic, double P[PZ][PZ]) {
    const double *m = g->gamma, *weight = m + BOUNDS;
    for (int r = 0; r < PX; r++)
        for (int v = 0; v < PX / WIDTH; v++) AT(P[r], v) += AT(g->Hx[r], v);
    for (int n = 0; n < NU; n++) {
        P[PX + n][PX + n] += g->He[n] + m[n] + m[4 + n];
        g->R[n] = g->Hr[n] + m[8 + n] + m[12 + n];
    }
    const double *slacks = weight + g->rows;
    double left[MAX_ROWS]; /* weight of a row with its slack eliminated */
    for (int n = 0; n < g->rows / WIDTH; n++) {
        Lanes stiff = quadratic + AT(slacks, n);
        AT(g->by_Hs, n) = 1.0 / (stiff + AT(weight, n));
        AT(left, n) = AT(weight, n) * stiff * AT(g->by_Hs, n);
    }
    Lanes pp[3][4 / WIDTH] = {{{0}}};
    for (int n = 0; n < g->rows; n++)
        for (int r = 0; r < 3; r++) add(pp[r], left[n] * g->slope[n][r], g->slope[n], 4);
    for (int r = 0; r < 3; r++)
        for (int v = 0; v < 4 / WIDTH; v++) AT(P[r], v) += pp[r][v];
}

/* Stage gradient (with barrier) into p, by the pushes. */
static inline void add_gradient(Stage *g, double penalty, double p[PZ]) {
    const double *q = g->push, *push = q + BOUNDS, *slacks = push + g->rows;
    const double *weight = g->gamma + BOUNDS, *real = g->real + BOUNDS;
    Lanes by_rows[4 / WIDTH] = {{0}};
    for (int v = 0; v < PX / WIDTH; v++) AT(p, v) += AT(g->gx, v);
    for (int v = 0; v < NU / WIDTH; v++) {
        AT(p + PX, v) += AT(g->ge, v) - AT(q, v) + AT(q + 4, v);
        AT(g->r, v) = AT(g->gr, v) - AT(q + 8, v) + AT(q + 12, v);
    }
    double pull[MAX_ROWS]; /* push of a row with its slack eliminated */
    for (int n = 0; n < g->rows / WIDTH; n++) {
        AT(g->gs, n) = AT(real, n) * (penalty - AT(push, n) - AT(slacks, n));
        AT(pull, n) = AT(push, n) + AT(weight, n) * AT(g->by_Hs, n) * AT(g->gs, n);
    }
    for (int n = 0; n < g->rows; n++) add(by_rows, -pull[n], g->slope[n], 4);
    for (int v = 0; v < 4 / WIDTH; v++) AT(p, v) += by_rows[v];
}
