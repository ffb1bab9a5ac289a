"""Filters and scores of a profile, kept between pods and repaired from the change log.

```
 pod ──▶ ProfileRunner ──▶ ResultCache ────────────▶ Evaluation ─────────────────▶ chosen node, reasons
         PreFilter,        one Evaluation per         reason per row (first filter
         counters          pod class                  that rejects, 0 = feasible)
                              │                          │ combines        │ adds up
                              ▼                          ▼                 ▼
                           ColumnCache ──▶ FilterColumn per plugin   TotalScores ──▶ TopRows
                           (by what a  ──▶ ScoreColumn per plugin ──▶ total per row   best rows
                           plugin reads)        ▲
 node, pod, volume … ──▶ Cache ──▶ change log ──┘ which rows changed, and in what
```

| what is kept | by what key | what makes it out of date | what repairs it |
|---|---|---|---|
| `FilterColumn`: reason code per row | plugin; values of its `reads` | a change of its `node_reads` (`interest`) | `filter_row` or `filter` for the changed rows |
| `ScoreColumn`: raw score per row | the same | the same | `score_row` or `score` for the changed rows |
| `ScoreColumn`: raw score per `AmountCodes` code, of plugins with `score_row` | the same | never; dropped when codes are given out anew | scores of changed rows with other amounts |
| `RelativeColumn`: nothing per row | the same | the same | `score_among` for the feasible rows |
| `Evaluation`: first reason per row | pod class: all that any plugin reads of a pod | a row of a column, or a column's `epoch` | the changed rows; all after another epoch |
| `TotalScores`: weighted total per row | the same | the same, and another set of feasible rows where a score is normalised | the changed rows; all after another epoch or set |
| `TopRows`: sets of rows with equal totals | the same | another total | moves single rows; looked for anew after all changed |
| `front`: the best ten for `/explain` | the same | a row of it changed, or another one is better | made anew |

Each column remembers the position in the change log up to which it is true. It is computed anew, and its `epoch` grows, after a change that
concerns more than the changed rows (the plugin is neither `row_local` nor `confined`), after more than `MOST_REPAIRED` log entries and for
more rows than before. Rows of nodes that are gone have the reason `HOLE`. A pod whose PreFilter names nodes is computed for these rows alone.

All of this is an optimisation: `ProfileRunner(caching=False)` computes everything each time, and property tests compare the two.
"""
