/* The interior-point method on the stages of kernel_stage.c, which is compiled before this. */

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

static void back_substitute(double S[NU][NU], double *b) {
    for (int i = 0; i < NU; i++) {
        for (int k = 0; k < i; k++) b[i] -= S[i][k] * b[k];
        b[i] *= S[i][i];
    }
    for (int i = NU - 1; i >= 0; i--) {
        for (int k = i + 1; k < NU; k++) b[i] -= S[k][i] * b[k];
        b[i] *= S[i][i];
    }
}

/* The same for all columns of K at once. */
static void back_substitute_rows(double S[NU][NU], double K[NU][PAD]) {
    for (int i = 0; i < NU; i++)
        for (int v = 0; v < PAD / 4; v++) {
            Four sum = AT(K[i], v);
            for (int k = 0; k < i; k++) sum -= S[i][k] * AT(K[k], v);
            AT(K[i], v) = sum * S[i][i];
        }
    for (int i = NU - 1; i >= 0; i--)
        for (int v = 0; v < PAD / 4; v++) {
            Four sum = AT(K[i], v);
            for (int k = i + 1; k < NU; k++) sum -= S[k][i] * AT(K[k], v);
            AT(K[i], v) = sum * S[i][i];
        }
}

/* row += sum over k of weights[k * stride] * rows[k], k < NX. */
static inline void combine(double *row, const double *weights, int stride, double rows[][PAD]) {
    Four a = AT(row, 0), b = AT(row, 1), c = AT(row, 2), d = AT(row, 3);
    for (int k = 0; k < NX; k++) {
        double weight = weights[k * stride];
        a += weight * AT(rows[k], 0);
        b += weight * AT(rows[k], 1);
        c += weight * AT(rows[k], 2);
        d += weight * AT(rows[k], 3);
    }
    AT(row, 0) = a, AT(row, 1) = b, AT(row, 2) = c, AT(row, 3) = d;
}

/* Find the gains of all stages by the Riccati recursion; return 0 where a factor is singular. */
static int factorise(Stage *stages, int N, double quadratic) {
    double P[NZ][PAD], T[NZ][PAD], M[NZ][PAD];
    memset(P, 0, sizeof P);
    for (int i = N - 1; i >= 0; i--) {
        Stage *g = stages + i;
        add_hessian(g, quadratic, P);
        double Pb[PAD] = {0};
        for (int k = 0; k < NX; k++) /* P is symmetric: its rows are its columns */
            for (int v = 0; v < PAD / 4; v++) AT(Pb, v) += g->gap[k] * AT(P[k], v);
        memcpy(g->Pb, Pb, sizeof Pb);
        for (int r = 0; r < NZ; r++) { /* T = P [F; 0 I] */
            memset(T[r], 0, sizeof T[r]);
            for (int n = 0; n < NU; n++) T[r][NX + n] = P[r][NX + n];
            combine(T[r], P[r], 1, g->F);
        }
        for (int r = 0; r < NZ; r++) { /* M = [F; 0 I]' T */
            if (r < NX) memset(M[r], 0, sizeof M[r]);
            else memcpy(M[r], T[r], sizeof M[r]);
            combine(M[r], &g->F[0][r], PAD, T);
        }
        for (int r = 0; r < NU; r++) {
            for (int c = 0; c < NU; c++) g->S[r][c] = M[NX + r][NX + c];
            g->S[r][r] += g->R[r];
            memset(g->K[r], 0, sizeof g->K[r]);
            for (int c = 0; c < NX; c++) g->K[r][c] = M[c][NX + r];
            g->K[r][NX + r] = -g->R[r];
        }
        if (!cholesky(g->S)) return 0;
        back_substitute_rows(g->S, g->K);
        for (int c = 0; c < NZ; c++)
            for (int r = 0; r < NU; r++) g->Kt[c][r] = g->K[r][c];
        for (int r = 0; r < NX; r++)
            for (int v = 0; v < PAD / 4; v++) {
                Four sum = AT(M[r], v);
                if (v >= NX / 4) /* columns of w_before start from zero */
                    for (int c = 0; c < 4; c++)
                        if (4 * v + c >= NX) sum[c] = 0.0;
                for (int k = 0; k < NU; k++) sum -= M[r][NX + k] * AT(g->K[k], v);
                AT(P[r], v) = sum;
            }
        for (int r = 0; r < NU; r++) {
            for (int v = 0; v < PAD / 4; v++) AT(P[NX + r], v) = g->R[r] * AT(g->K[r], v);
            P[NX + r][NX + r] += g->R[r];
        }
        for (int r = 0; r < NZ; r++) /* keep it symmetric to the last bit */
            for (int c = 0; c < r; c++) P[r][c] = P[c][r] = 0.5 * (P[r][c] + P[c][r]);
    }
    return 1;
}

/* Find the next point for the present pushes. */
static void solve_point(Stage *stages, int N, double penalty) {
    double p[PAD] = {0}, k[MAX_STAGES][NU];
    for (int i = N - 1; i >= 0; i--) {
        Stage *g = stages + i;
        add_gradient(g, penalty, p);
        double y[PAD], m[PAD] = {0}, linear[NU];
        for (int n = 0; n < PAD; n++) y[n] = p[n] + g->Pb[n];
        for (int n = 0; n < NU; n++) m[NX + n] = y[NX + n];
        combine(m, y, 1, g->F);
        for (int n = 0; n < NU; n++) k[i][n] = linear[n] = m[NX + n] + g->r[n];
        back_substitute(g->S, k[i]);
        for (int n = 0; n < NX; n++) p[n] = m[n];
        for (int n = 0; n < NU; n++) p[NX + n] = -g->r[n];
        for (int v = 0; v < PAD / 4; v++)
            for (int n = 0; n < NU; n++) AT(p, v) -= linear[n] * AT(g->K[n], v);
    }
    double z[NZ] = {0};
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        double x[12] = {0};
        Four w = -AT(k[i], 0);
        for (int c = 0; c < NZ; c++) w -= z[c] * AT(g->Kt[c], 0);
        AT(g->wn, 0) = w;
        memcpy(x, g->gap, sizeof g->gap);
        for (int v = 0; v < 3; v++) {
            Four sum = AT(x, v);
            for (int c = 0; c < NX; c++) sum += z[c] * AT(g->Ft[c], v);
            for (int c = 0; c < NU; c++) sum += g->wn[c] * AT(g->Ft[NX + c], v);
            AT(x, v) = sum;
        }
        memcpy(g->xn, x, sizeof g->xn);
        memcpy(z, x, sizeof g->xn);
        memcpy(z + NX, g->wn, sizeof g->wn);
        for (int n = 0; n < 2; n++)
            g->sn[n] = g->slacks[n] ? -(g->gs[n] + g->Hps[n][0] * x[0] + g->Hps[n][1] * x[1] +
                                        g->Hps[n][2] * x[2]) / g->Hs[n]
                                    : 0.0;
    }
}

/* Find the steps of t and l to the next point; return the longest, up to 1, that keeps them > 0. */
static double steps(Stage *stages, int N) {
    static const double none[NU] = {0};
    double longest = 1.0, next[BOUNDS + MAX_ROWS + 2];
    for (int i = 0; i < N; i++) {
        Stage *g = stages + i;
        values(g, g->xn, g->wn, g->sn, i ? stages[i - 1].wn : none, next);
        int count = constraints(g);
        for (int c = 0; c < count; c++) {
            if (!used(g, c)) continue;
            g->dt[c] = next[c] + g->a[c] - g->t[c];
            g->dl[c] = g->push[c] - g->gamma[c] * next[c] - g->l[c];
            if (g->dt[c] < 0.0 && -g->t[c] > longest * g->dt[c]) longest = -g->t[c] / g->dt[c];
            if (g->dl[c] < 0.0 && -g->l[c] > longest * g->dl[c]) longest = -g->l[c] / g->dl[c];
        }
    }
    return longest;
}

/* Find the steps dx, du of the quadratic program; return the iterations taken, or -1. */
int solve_program(const Program *given) {
    const Program program = *given, *p = &program;
    Stage *stages = p->work;
    static const double none[NU] = {0};
    if (p->rows > MAX_ROWS || p->N > MAX_STAGES) return -1;
    load(p, stages);

    int total = 0;
    for (int i = 0; i < p->N; i++) {
        Stage *g = stages + i;
        memset(g->x, 0, sizeof g->x);
        memset(g->w, 0, sizeof g->w);
        double deepest[2] = {0.0, 0.0}, now[BOUNDS + MAX_ROWS + 2];
        for (int n = 0; n < g->rows; n++)
            if (-g->a[BOUNDS + n] > deepest[g->kind[n]]) deepest[g->kind[n]] = -g->a[BOUNDS + n];
        for (int k = 0; k < 2; k++) g->s[k] = g->slacks[k] ? deepest[k] + 0.05 : 0.0;
        values(g, g->x, g->w, g->s, none, now);
        for (int c = 0; c < constraints(g); c++) {
            double t = now[c] + g->a[c];
            g->t[c] = t > 0.03 ? t : 0.03;
            g->l[c] = p->first_complementarity / g->t[c];
            total += used(g, c);
        }
    }

    double infeasible = 1.0;
    for (int iteration = 1; iteration <= MAX_ITERATIONS; iteration++) {
        double mu = 0.0;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int c = 0; c < constraints(g); c++) {
                if (!used(g, c)) { g->gamma[c] = g->push[c] = 0.0; continue; }
                mu += g->t[c] * g->l[c];
                g->gamma[c] = g->l[c] / g->t[c];
                g->push[c] = g->l[c] - g->gamma[c] * g->a[c];
            }
        }
        mu /= total;
        int last = iteration == MAX_ITERATIONS; /* good enough for an SQP step, then */
        double enough = last ? 100.0 * p->tolerance : p->tolerance;
        if (mu < enough && infeasible < enough) {
            for (int i = 0; i < p->N; i++) {
                memcpy(p->dx + i * NX, stages[i].x, sizeof stages[i].x);
                memcpy(p->du + i * NU, stages[i].w, sizeof stages[i].w);
            }
            return iteration - 1;
        }
        if (!factorise(stages, p->N, p->quadratic)) return -1;
        solve_point(stages, p->N, p->penalty);
        double length = steps(stages, p->N), ahead = 0.0;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int c = 0; c < constraints(g); c++)
                if (used(g, c))
                    ahead += (g->t[c] + length * g->dt[c]) * (g->l[c] + length * g->dl[c]);
        }
        ahead /= total;
        double sigma = ahead / mu;
        sigma = sigma * sigma * sigma;
        double target = sigma * mu;
        /* The second-order term holds at the end of the predictor's step. Where that step was
         * short, taking all of it makes the iteration cycle; its square is Colombo and
         * Gondzio's least weight. */
        double weight = length * length;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int c = 0; c < constraints(g); c++)
                if (used(g, c)) g->push[c] += (target - weight * g->dt[c] * g->dl[c]) / g->t[c];
        }
        solve_point(stages, p->N, p->penalty);
        length = steps(stages, p->N);
        if (length < 1.0) length *= 1.0 - fmin(5e-3, mu);
        if (!(length > 1e-10)) return -1;
        for (int i = 0; i < p->N; i++) {
            Stage *g = stages + i;
            for (int n = 0; n < NX; n++) g->x[n] += length * (g->xn[n] - g->x[n]);
            for (int n = 0; n < NU; n++) g->w[n] += length * (g->wn[n] - g->w[n]);
            for (int n = 0; n < 2; n++) g->s[n] += length * (g->sn[n] - g->s[n]);
            for (int c = 0; c < constraints(g); c++)
                if (used(g, c)) {
                    g->t[c] += length * g->dt[c];
                    g->l[c] += length * g->dl[c];
                }
        }
        infeasible *= 1.0 - length;
    }
    return -1;
}
