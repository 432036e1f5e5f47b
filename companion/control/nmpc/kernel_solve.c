/* The interior-point method on the stages of kernel_stage.c, which is compiled before this. */

typedef long long Mask __attribute__((vector_size(32)));

static inline Four larger(Four a, Four b) {
    Mask mask = a > b;
    return (Four)((mask & (Mask)a) | (~mask & (Mask)b));
}

static inline double sum(Four v) { return (v[0] + v[1]) + (v[2] + v[3]); }

static int cholesky(double S[NU][NU]) {
    for (int j = 0; j < NU; j++) {
        for (int k = 0; k < j; k++)
            for (int i = j; i < NU; i++) S[i][j] -= S[i][k] * S[j][k];
        if (!(S[j][j] > 0.0)) return 0;
        S[j][j] = 1.0 / sqrt(S[j][j]);
        for (int i = j + 1; i < NU; i++) S[i][j] *= S[j][j];
    }
    return 1;
}

/* Find the gains of all stages by the Riccati recursion; return 0 where a factor is singular. */
static int factorise(Stage *stages, int N, double dt, double quadratic) {
    double P[PZ][PZ], T[PZ][DENSE], M[DENSE][DENSE];
    memset(P, 0, sizeof P);
    memset(T, 0, sizeof T);
    for (int i = N - 1; i >= 0; i--) {
        Stage *g = stages + i;
        add_hessian(g, quadratic, P);
        Four Pb[4] = {{0}};
        for (int k = 0; k < PX; k++) { /* P is symmetric: its rows are its columns */
            if (EMPTY(k)) continue;
            for (int v = 0; v < 4; v++) Pb[v] += g->gap[k] * AT(P[k], v);
        }
        for (int v = 0; v < 4; v++) AT(g->Pb, v) = Pb[v];
        for (int r = 0; r < PZ; r++) { /* T = P [F; 0 I], without the double integrator's columns */
            if (EMPTY(r)) continue;
            Four q = {0}, w = AT(P[r], 3);
            for (int k = 0; k < PX; k++) {
                if (EMPTY(k)) continue;
                q += P[r][k] * AT(g->F[k], 0);
                w += P[r][k] * AT(g->F[k], 1);
            }
            AT(T[r], 0) = q, AT(T[r], 1) = w;
        }
        for (int r = 0; r < DENSE; r++) { /* M = [F; 0 I]' T, rows of attitude and w */
            Four q = {0}, w = {0};
            if (r >= 4) q = AT(T[PX + r - 4], 0), w = AT(T[PX + r - 4], 1);
            for (int k = 0; k < PX; k++) {
                if (EMPTY(k)) continue;
                q += g->F[k][r] * AT(T[k], 0);
                w += g->F[k][r] * AT(T[k], 1);
            }
            AT(M[r], 0) = q, AT(M[r], 1) = w;
        }
        for (int r = 0; r < 3; r++) { /* M, rows of position and velocity, in place of P and T */
            double *p = P[r], *v = P[4 + r];
            AT(v, 0) += dt * AT(p, 0);
            AT(v, 1) += dt * AT(p, 1);
            AT(p, 1) += dt * AT(p, 0);
            AT(v, 1) += dt * AT(v, 0);
            for (int n = 0; n < 2; n++) AT(T[4 + r], n) += dt * AT(T[r], n);
        }
        for (int r = 0; r < NU; r++) {
            for (int c = 0; c < NU; c++) g->L[r][c] = M[4 + r][4 + c];
            g->L[r][r] += g->R[r];
        }
        if (!cholesky(g->L)) return 0;
        Four Y[NU][4], K[NU][4];
        for (int r = 0; r < NU; r++) {
            for (int v = 0; v < 2; v++)
                Y[r][v] = (Four){T[4 * v][4 + r], T[4 * v + 1][4 + r], T[4 * v + 2][4 + r], 0.0};
            Y[r][2] = AT(M[4 + r], 0);
            Y[r][3] = (Four){0};
            Y[r][3][r] = -g->R[r];
        }
        for (int v = 0; v < 4; v++) {
            for (int r = 0; r < NU; r++) {
                for (int k = 0; k < r; k++) Y[r][v] -= g->L[r][k] * Y[k][v];
                Y[r][v] *= g->L[r][r];
                AT(g->Y[r], v) = Y[r][v];
            }
            for (int r = NU - 1; r >= 0; r--) {
                K[r][v] = Y[r][v];
                for (int k = r + 1; k < NU; k++) K[r][v] -= g->L[k][r] * K[k][v];
                K[r][v] *= g->L[r][r];
            }
            for (int n = 0; n < 4; n++)
                AT(g->Kt[4 * v + n], 0) = (Four){K[0][v][n], K[1][v][n], K[2][v][n], K[3][v][n]};
        }
        for (int r = 0; r < 4; r++) { /* the rest of M, into P */
            if (r < 3) AT(P[r], 2) = AT(T[r], 0), AT(P[4 + r], 2) = AT(T[4 + r], 0);
            AT(P[8 + r], 0) = (Four){T[0][r], T[1][r], T[2][r], 0.0};
            AT(P[8 + r], 1) = (Four){T[4][r], T[5][r], T[6][r], 0.0};
            AT(P[8 + r], 2) = AT(M[r], 0);
            for (int v = 0; v < 4; v++) {
                AT(P[4 * v + r], 3) = (Four){0};
                AT(P[12 + r], v) = (Four){0};
            }
            P[12 + r][12 + r] = g->R[r];
        }
        for (int r = 0; r < PZ; r++) {
            if (EMPTY(r)) continue;
            for (int v = 0; v < 4; v++)
                for (int k = 0; k < NU; k++) AT(P[r], v) -= g->Y[k][r] * Y[k][v];
        }
    }
    return 1;
}

/* Find the next point for the present pushes. */
static void solve_point(Stage *stages, int N, double dt, double penalty) {
    Four p[4] = {{0}};
    double k[MAX_STAGES][NU];
    for (int i = N - 1; i >= 0; i--) {
        Stage *g = stages + i;
        add_gradient(g, penalty, p);
        double y[PZ], low[NU];
        for (int v = 0; v < 4; v++) AT(y, v) = p[v] + AT(g->Pb, v);
        Four q = {0}, w = AT(y, 3) + AT(g->r, 0);
        for (int n = 0; n < PX; n++) {
            if (EMPTY(n)) continue;
            q += y[n] * AT(g->F[n], 0);
            w += y[n] * AT(g->F[n], 1);
        }
        for (int n = 0; n < NU; n++) {
            low[n] = w[n];
            for (int m = 0; m < n; m++) low[n] -= g->L[n][m] * low[m];
            low[n] *= g->L[n][n];
        }
        for (int n = NU - 1; n >= 0; n--) {
            k[i][n] = low[n];
            for (int m = n + 1; m < NU; m++) k[i][n] -= g->L[m][n] * k[i][m];
            k[i][n] *= g->L[n][n];
        }
        p[0] = AT(y, 0), p[1] = AT(y, 1) + dt * AT(y, 0), p[2] = q, p[3] = -AT(g->r, 0);
        for (int v = 0; v < 4; v++)
            for (int n = 0; n < NU; n++) p[v] -= low[n] * AT(g->Y[n], v);
    }
    double z[PZ] = {0};
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        Four w = -AT(k[i], 0), more = {0};
        for (int c = 0; c < PZ; c += 2) {
            w -= z[c] * AT(g->Kt[c], 0);
            if (!EMPTY(c + 1)) more -= z[c + 1] * AT(g->Kt[c + 1], 0);
        }
        AT(g->wn, 0) = w += more;
        Four x[3] = {AT(z, 0) + dt * AT(z, 1), AT(z, 1), {0}};
        for (int v = 0; v < 3; v++) {
            x[v] += AT(g->gap, v);
            for (int c = 0; c < 4; c++) x[v] += z[8 + c] * AT(g->Ft[c], v);
            for (int c = 0; c < NU; c++) x[v] += w[c] * AT(g->Ft[4 + c], v);
            AT(g->xn, v) = AT(z, v) = x[v];
        }
        AT(z, 3) = w;
        for (int n = 0; n < 2; n++)
            g->sn[n] = g->slacks[n] ? -(g->gs[n] + sum(AT(g->Hps[n], 0) * x[0])) / g->Hs[n] : 0.0;
    }
}

/* The way from the point to the next one: the longest step, up to 1, that keeps t and l > 0, and
 * the sums of t l and of its first and second derivative by the length of the step. */
typedef struct {
    double longest, zeroth, first, second;
} Way;

/* Find the steps of t and l to the next point. */
static Way steps(Stage *stages, int N) {
    static const double none[NU] = {0};
    double next[MAX_CONSTRAINTS];
    Four worst = {1.0, 1.0, 1.0, 1.0}, zeroth = {0}, first = {0}, second = {0};
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        values(g, g->xn, g->wn, g->sn, i ? stages[i - 1].wn : none, next);
        for (int c = 0; c < g->constraints / 4; c++) {
            Four t = AT(g->t, c), l = AT(g->l, c), real = AT(g->real, c);
            Four dt = real * (AT(next, c) + AT(g->a, c) - t);
            Four dl = real * (AT(g->push, c) - AT(g->gamma, c) * AT(next, c) - l);
            AT(g->dt, c) = dt;
            AT(g->dl, c) = dl;
            worst = larger(larger(worst, -dt * AT(g->inverse, c)), -dl / l);
            zeroth += real * t * l;
            first += t * dl + l * dt;
            second += dt * dl;
        }
    }
    double most = fmax(fmax(worst[0], worst[1]), fmax(worst[2], worst[3]));
    return (Way){1.0 / most, sum(zeroth), sum(first), sum(second)};
}

/* Return how far the constraint that is broken most is broken by no step and no slack. */
static double broken(const Stage *stages, int N) {
    double most = 0.0;
    for (int i = 0; i < N; i++)
        for (int c = 0; c < stages[i].constraints; c++) most = fmax(most, -stages[i].a[c]);
    return most;
}

/* Return the deepest of the margins from..to. */
static double deepest(const Stage *g, int from, int to) {
    double most = 0.0;
    for (int n = from; n < to; n++) most = fmax(most, -g->a[BOUNDS + n]);
    return most;
}

/* Return the multiplier that constraint c of a stage had at the last solution; or where it is. */
static double *kept(Stage *g, int c) {
    int slacks = g->constraints - 4;
    if (c < BOUNDS) return g->kept + c;
    return g->kept + BOUNDS + (c < slacks ? g->row[c - BOUNDS] : MAX_ROWS + c - slacks);
}

/* Keep the multipliers of a solution. */
static void keep(Stage *stages, int N, int rows) {
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        memset(g->kept, 0, (BOUNDS + rows) * sizeof g->kept[0]);
        g->kept[KEPT - 2] = g->kept[KEPT - 1] = 0.0;
        for (int c = 0; c < g->constraints; c++)
            if (g->real[c]) *kept(g, c) = g->l[c];
    }
}

/* Set the first point, which makes no step; return the number of constraints. */
static double begin(const Program *p, Stage *stages) {
    static const double none[NU] = {0};
    double room = LEAST_ROOM, total = 0.0;
    if (!p->again) room = fmin(fmax(room, broken(stages, p->N)), MOST_ROOM);
    for (int i = 0; i < p->N; i++) {
        Stage *g = stages + i;
        memset(g->x, 0, sizeof g->x);
        memset(g->w, 0, sizeof g->w);
        for (int k = 0, from = 0; k < 2; from += g->rows[k++]) {
            if (!p->again) g->s[k] = deepest(g, from, from + g->rows[k]) + room;
            g->s[k] = g->slacks[k] ? fmax(g->s[k], LEAST_SLACK) : 0.0;
        }
        values(g, g->x, g->w, g->s, none, g->t);
        for (int c = 0; c < g->constraints; c++) {
            double before = p->again && g->real[c] ? *kept(g, c) : 0.0;
            g->t[c] = g->real[c] ? fmax(g->t[c] + g->a[c], room) : 1.0;
            g->l[c] = g->real[c] ? fmax(p->complementarity / g->t[c], before) : NOTHING;
            total += g->real[c];
        }
    }
    return total;
}

/* Set gamma and the pushes without target; return the sum of t l. */
static double weigh(Stage *stages, int N) {
    Four all = {0};
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        for (int c = 0; c < g->constraints / 4; c++) {
            Four t = AT(g->t, c), l = AT(g->l, c), inverse = 1.0 / t;
            AT(g->inverse, c) = inverse;
            AT(g->gamma, c) = l * inverse;
            AT(g->push, c) = l - l * inverse * AT(g->a, c);
            all += AT(g->real, c) * t * l;
        }
    }
    return sum(all);
}

/* Find the steps dx, du of the quadratic program; return the iterations taken, or -1. */
int solve_program(const Program *given) {
    const Program program = *given, *p = &program;
    Stage *stages = p->work;
    if (p->rows > MAX_ROWS || p->N > MAX_STAGES) return -1;
    load(p, stages);
    double total = begin(p, stages), infeasible = 1.0;
    for (int iteration = 1; iteration <= MAX_ITERATIONS; iteration++) {
        double mu = weigh(stages, p->N) / total;
        int last = iteration == MAX_ITERATIONS; /* good enough for an SQP step, then */
        double enough = last ? 100.0 * p->tolerance : p->tolerance;
        if (mu < enough && infeasible < enough) {
            for (int i = 0; i < p->N; i++) {
                for (int n = 0; n < NX; n++) p->dx[i * NX + n] = stages[i].x[PLACE(n)];
                memcpy(p->du + i * NU, stages[i].w, sizeof stages[i].w);
            }
            keep(stages, p->N, p->rows);
            return iteration - 1;
        }
        if (!factorise(stages, p->N, p->dt, p->quadratic)) return -1;
        solve_point(stages, p->N, p->dt, p->penalty);
        Way way = steps(stages, p->N);
        double length = way.longest;
        double ahead = (way.zeroth + length * (way.first + length * way.second)) / total;
        double sigma = ahead / mu;
        sigma = sigma * sigma * sigma;
        double target = sigma * mu;
        /* The second-order term holds at the end of the predictor's step. Where that step was
         * short, taking all of it makes the iteration cycle; its square is Colombo and
         * Gondzio's least weight. */
        double weight = length * length;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int c = 0; c < g->constraints / 4; c++)
                AT(g->push, c) += AT(g->real, c) * AT(g->inverse, c) *
                                  (target - weight * AT(g->dt, c) * AT(g->dl, c));
        }
        solve_point(stages, p->N, p->dt, p->penalty);
        length = steps(stages, p->N).longest;
        if (length < 1.0) length *= 1.0 - fmin(5e-3, mu);
        if (!(length > 1e-10)) return -1;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int v = 0; v < 3; v++) AT(g->x, v) += length * (AT(g->xn, v) - AT(g->x, v));
            AT(g->w, 0) += length * (AT(g->wn, 0) - AT(g->w, 0));
            for (int n = 0; n < 2; n++) g->s[n] += length * (g->sn[n] - g->s[n]);
            for (int c = 0; c < g->constraints / 4; c++) {
                AT(g->t, c) += length * AT(g->dt, c);
                AT(g->l, c) += length * AT(g->dl, c);
            }
        }
        infeasible *= 1.0 - length;
    }
    return -1;
}
